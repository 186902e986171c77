# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""No bag unpacks to more than it declares, nor to more than the user allows."""

import sqlite3
import subprocess
import sys

import bag_making as make
import lz4.frame
import pytest
import zstandard
from mcap.reader import make_reader

from estimator_pkg import cli
from estimator_pkg.bags import unpacking
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.errors import UserError

MIB = unpacking.MIB
BOMBS = {
    'zstd': lambda size: zstandard.compress(bytes(size)),
    'zstd without its size': lambda size: zstandard.ZstdCompressor(
        write_content_size=False
    ).compress(bytes(size)),
    'lz4': lambda size: lz4.frame.compress(bytes(size)),
    'lz4 without its size': lambda size: lz4.frame.compress(bytes(size), store_size=False),
}


def with_chunk(path, kind, unpacked, declared):
    """An MCAP without index whose second chunk unpacks to `unpacked` and declares `declared`.

    `unpacked` is a number of bytes, or the bytes.
    """
    from mcap.data_stream import RecordBuilder
    from mcap.records import Chunk

    make.mcap(path, make.content(5), chunk_size=1)
    with open(path, 'rb') as stream:
        index = make_reader(stream).get_summary().chunk_indexes[-1]
    packed = BOMBS[kind](unpacked)
    builder = RecordBuilder()
    Chunk(
        compression=kind.split()[0],
        data=packed,
        message_start_time=make.START,
        message_end_time=make.START,
        uncompressed_crc=0,
        uncompressed_size=declared,
    ).write(builder)
    whole = path.read_bytes()
    path.write_bytes(
        whole[: index.chunk_start_offset]
        + builder.end()
        + whole[index.chunk_start_offset : index.chunk_start_offset + index.chunk_length]
    )
    return path


PEAK = """
import sys
import lz4.frame, zstandard
from estimator_pkg.bags import mcap_file, sqlite_file
from estimator_pkg.bags.reader import open_bag
from estimator_pkg.errors import UserError
def peak():
    with open('/proc/self/status') as status:
        return next(int(line.split()[1]) for line in status if line.startswith('VmHWM'))
before = peak()
try:
    with open_bag(sys.argv[1], int(sys.argv[2])) as bag:
        for _ in bag.blocks():
            pass
except UserError as error:
    print(error, file=sys.stderr)
print(peak() - before)
"""


def read_in_process(path, limit):
    """(what it says, MiB that a process needs to read a bag)."""
    words = [sys.executable, '-c', PEAK, str(path), str(limit)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=240, check=True)
    return done.stderr, int(done.stdout) / 1024


def with_a_chunk_that_lies(path, kind, size):
    return with_chunk(path, kind, size, 1000 if size < 100 * MIB else size)


def overlapping(path, kind, size):
    """Chunks of a quarter of `size` bytes, each with messages from all of the time."""
    message = make.text('x' * (8 * MIB))
    times = [i % 2 * 10**9 for i in range(2 * size // (8 * MIB))]
    return make.mcap(
        path, [(make.OTHER, make.START + t, message) for t in times], chunk_size=size // 4
    )


def with_tiny_messages(path, kind, size):
    """A chunk of as many messages as have place in it, which takes more memory than its bytes."""
    record = b'\5' + (22).to_bytes(8, 'little') + (1).to_bytes(2, 'little') + bytes(20)
    records = record * (size // len(record))
    return with_chunk(path, kind, records, len(records))


def with_message(path, kind, size):
    """A bag with messages compressed one by one, one of which unpacks to `size` bytes."""
    path = make.KINDS['sqlite3, messages compressed'](path.with_suffix(''), make.content(9))
    with sqlite3.connect(next(path.glob('*.db3'))) as base:
        base.execute('update messages set data = ? where id = 3', (BOMBS[kind](size),))
    base.close()
    return path


def varint(number):
    """An integer as sqlite3 writes it."""
    parts = [number >> shift & 127 for shift in range(0, number.bit_length(), 7)]
    return bytes([*(128 | part for part in parts[:0:-1]), parts[0]])


def with_a_loop_of_pages(path, kind, size):
    """A database of 45 kB with a message of about `size` bytes, whose last page is its own next."""
    path = make.KINDS['sqlite3'](path.with_suffix(''), make.content(50))
    (file,) = path.glob('*.db3')
    time = make.START + 10**9
    with sqlite3.connect(file) as base:
        base.execute(
            'insert into messages(topic_id, timestamp, data) values (1, ?, zeroblob(9000))', (time,)
        )
        assert base.execute('pragma page_size').fetchone() == (4096,)
    base.close()
    raw = bytearray(file.read_bytes())
    last = len(raw) // 4096
    payload = 489 + 4092 * (size // 4092)  # so much of it is in the cell, and whole pages
    blob = varint(2 * payload - (20 if size < 2**27 else 22))  # 12, and twice its bytes
    head = bytes([4 + len(blob), 0, 9, 6]) + blob + time.to_bytes(8, 'big')  # NULL, 1, 8 bytes
    cell = raw.rindex(time.to_bytes(8, 'big')) - 10
    rowid = raw[cell + 2 : cell + 3]
    new = varint(payload) + rowid + head.ljust(489, b'\0') + last.to_bytes(4, 'big')
    raw[cell : cell + len(new)] = new
    raw[-4096:-4092] = last.to_bytes(4, 'big')
    file.write_bytes(raw)
    return path


@pytest.mark.long
@pytest.mark.parametrize(
    'bomb, kind',
    [
        (with_a_chunk_that_lies, 'zstd'),
        (with_a_chunk_that_lies, 'lz4 without its size'),
        (with_a_loop_of_pages, 'sqlite3'),
        (with_tiny_messages, 'zstd'),
        (with_message, 'zstd'),
        (overlapping, ''),
    ],
)
def test_no_more_memory_than_the_limit_is_needed(bomb, kind, tmp_path):
    for size in (64 * MIB, 200 * MIB):  # as large as allowed, and refused
        path = bomb(tmp_path / f'{size}.mcap', kind, size)
        said, used = read_in_process(path, 64 * MIB)
        assert used < 64 + 24, (size // MIB, said)
        damaged = 'string or blob too big' in said
        assert damaged if kind == 'sqlite3' else 'raise --unpack-limit' in said or size == 64 * MIB


@pytest.mark.parametrize('kind', BOMBS)
def test_a_chunk_unpacks_to_no_more_than_the_limit(kind, tmp_path, capsys):
    path = with_chunk(tmp_path / 'bag.mcap', kind, 3 * MIB, 3 * MIB)
    with pytest.raises(
        UserError,
        match=r'the chunk at byte \d+ unpacks to more than 2 MiB: if '
        'you trust the bag, raise --unpack-limit',
    ):
        open_bag(path, 2 * MIB)
    with open_bag(path) as bag:
        assert bag.count == 7
    capsys.readouterr()
    assert cli.main(['replay', str(path), '--unpack-limit', '2']) == 1
    said = capsys.readouterr().err
    assert 'raise --unpack-limit' in said and said.count('\n') == 1
    assert cli.main(['replay', str(path), '--unpack-limit', '0']) == 2


def test_a_file_without_chunks_is_not_unpacked(tmp_path):
    path = make.KINDS['mcap without chunks'](tmp_path / 'bag', make.content(200))
    with open_bag(path, 1000) as bag:
        assert len(list(bag.messages())) == bag.count == 267


def test_many_large_messages_come_a_few_at_a_time(tmp_path):
    path = make.KINDS['sqlite3, messages compressed'](tmp_path / 'bag', make.content(30))
    with sqlite3.connect(next(path.glob('*.db3'))) as base:
        base.execute('update messages set data = ?', (BOMBS['zstd'](3 * MIB),))
    base.close()
    with open_bag(path) as bag:
        sizes = [len(block.data) for _, block in bag.blocks()]
    assert sum(sizes) == 40 * 3 * MIB and max(sizes) <= 6 * MIB


@pytest.mark.parametrize('kind', ['sqlite3, file compressed', 'mcap folder, file compressed'])
def test_a_compressed_file_is_bounded(kind, tmp_path, monkeypatch):
    path = make.KINDS[kind](tmp_path / 'bag', make.content(9))
    (packed,) = (file for file in path.iterdir() if file.suffix == '.zstd')
    packed.write_bytes(BOMBS['zstd without its size'](64 * MIB))
    monkeypatch.setattr(unpacking, 'UNPACK_RATIO', 2)
    with (
        make.no_file_above(4 * MIB),
        pytest.raises(UserError, match=f'{packed.name} unpacks to more than 1 MiB'),
    ):
        open_bag(path, MIB)
