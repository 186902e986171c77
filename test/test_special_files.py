# Copyright 2026 velocity_estimator contributors
# SPDX-License-Identifier: Apache-2.0

"""A pipe, socket or device that is named as an input is refused: it may never end."""

import os
import shutil
import socket
from pathlib import Path

import pytest

from estimator_pkg import cli

BAG = Path(__file__).parents[1] / 'bags' / 'simulated' / 'random_with_faults'
REFUSED = 'is a pipe, socket or device: name a file'
KINDS = ['pipe', 'socket', 'device']


@pytest.fixture(params=KINDS)
def special(request, tmp_path, monkeypatch):
    """The path of a file that never ends, named as a file of a bag."""
    monkeypatch.chdir(tmp_path)  # the name of a socket is short
    path = Path('special.mcap')
    if request.param == 'pipe':
        os.mkfifo(path)
    elif request.param == 'device':
        path.symlink_to('/dev/zero')
    else:
        with socket.socket(socket.AF_UNIX) as end:
            end.bind(str(path))
    return path


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    'words', [['replay', 'SPECIAL'], ['replay', str(BAG), '--params', 'SPECIAL']]
)
def test_a_command_refuses_it_in_one_line(words, special, capsys):
    assert cli.main([word.replace('SPECIAL', str(special)) for word in words]) != 0
    said = capsys.readouterr().err
    assert REFUSED in said and said.count('\n') == 1


@pytest.mark.timeout(60)
def test_within_the_folder_of_a_bag_nothing_waits_for_it(special, capsys):
    folder = shutil.copytree(BAG, 'bag')
    os.rename(special, Path(folder, special))
    os.unlink(Path(folder, 'metadata.yaml'))
    assert cli.main(['replay', str(folder)]) == 0
    assert f'{special}: it {REFUSED}; it is skipped' in capsys.readouterr().err
    os.rename(Path(folder, special), Path(folder, 'metadata.yaml'))
    assert cli.main(['replay', str(folder)]) == 1
    assert REFUSED in capsys.readouterr().err
