// Copyright 2026 velocity_estimator contributors
// SPDX-License-Identifier: Apache-2.0

// Plots over time of a report page. A group of panels shares the time axis; each pixel shows the
// lowest and the highest value of its stretch, so a line stays a line however long the record is.
'use strict';
const PAGE = JSON.parse(document.getElementById('data').textContent);
const LEFT = 66, RIGHT = 18, TITLE = 20, TIMES = 34, NARROWEST = 8;  // pixels; samples
const chosen = new Set(PAGE.chosen);
const colour = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function floats(text) {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new Float32Array(bytes.buffer);
}

// A curve: n items, each with a time, a lowest and a highest value.
class Curve {
  constructor(source) {
    Object.assign(this, source);
    const y = floats(source.y);
    this.low = i => y[i];
    this.high = this.low;
    if (source.t) {
      const t = floats(source.t);
      this.n = t.length;
      this.time = i => t[i];
    } else {  // stretches of equal length: the lowest and the highest value of each
      this.n = y.length / 2;
      this.time = i => source.first + (i + 0.5) * source.step;
      this.low = i => y[2 * i];
      this.high = i => y[2 * i + 1];
    }
  }
  before(time) {  // the number of items before it
    let low = 0, high = this.n;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.time(middle) < time) low = middle + 1; else high = middle;
    }
    return low;
  }
  between(start, end) {
    return [Math.max(0, this.before(start) - 1), Math.min(this.n, this.before(end) + 1)];
  }
}

function ticks(low, high, most) {
  const rough = (high - low) / most, power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(each => each * power).find(each => each >= rough);
  const found = [];
  for (let at = Math.ceil(low / step - 1e-9); at * step <= high + 1e-9 * step; at++) found.push(at * step);
  return [found, Math.max(0, -Math.floor(Math.log10(step) + 1e-9))];
}

class Panel {
  constructor(group, source, last) {
    Object.assign(this, {group, source, last});
    this.canvas = document.createElement('canvas');
    this.canvas.setAttribute('role', 'img');
    this.canvas.setAttribute('aria-label', source.title);
    this.height = source.height + TITLE + (last ? TIMES : 6);
    this.canvas.style.height = this.height + 'px';
    group.element.append(this.canvas);
  }
  get curves() {
    return this.decoded ??= this.source.curves.map(each => new Curve(each));
  }
  x(time) {
    const [start, end] = this.group.range;
    return LEFT + (time - start) / (end - start) * (this.width - LEFT - RIGHT);
  }
  strong(curve) { return !curve.s || chosen.has(curve.s); }

  // Range of the chosen curves in the time that is shown; an outlier does not compress the rest.
  limits() {
    if (this.source.ticks) return [-0.6, this.source.ticks.length - 0.4];
    const [start, end] = this.group.range, values = [];
    let least = Infinity, most = -Infinity;
    for (const curve of this.curves) {
      if (!this.strong(curve) || curve.kind === 'band') continue;
      const [first, last] = curve.between(start, end), every = Math.max(1, (last - first) >> 11);
      for (let i = first; i < last; i++) {
        const low = curve.low(i), high = curve.high(i);
        if (!(low <= high)) continue;
        if (low < least) least = low;
        if (high > most) most = high;
        if (i % every === 0) values.push(low, high);
      }
    }
    if (!values.length) return [-1, 1];
    values.sort((a, b) => a - b);
    const low = values[Math.floor(0.004 * values.length)];
    const high = values[Math.min(values.length - 1, Math.ceil(0.996 * values.length))];
    const room = 0.9 * Math.max(high - low, 1e-9 * Math.abs(high), 1e-12);
    least = Math.max(least, low - room);
    most = Math.min(most, high + room);
    const edge = 0.06 * Math.max(most - least, 1e-9);
    return [least - edge, most + edge];
  }

  draw() {
    const ratio = window.devicePixelRatio || 1, ctx = this.canvas.getContext('2d');
    this.width = this.canvas.clientWidth;
    if (!this.width) return;
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    ctx.scale(ratio, ratio);
    const bottom = TITLE + this.source.height, right = this.width - RIGHT;
    const [low, high] = this.shown = this.limits();
    const y = value => bottom - (value - low) / (high - low) * this.source.height;
    this.scale(ctx, y, low, high, bottom, right);
    ctx.save();
    ctx.beginPath();
    ctx.rect(LEFT, TITLE, right - LEFT, this.source.height);
    ctx.clip();
    const rank = curve => curve.kind === 'reference' ? 1 : !this.strong(curve) ? 0
      : curve.kind === 'band' ? 2 : curve.s === PAGE.chosen[0] ? 4 : 3;
    this.points = {};
    for (const curve of [...this.curves].sort((a, b) => rank(a) - rank(b))) this.line(ctx, curve, y);
    ctx.restore();
  }

  scale(ctx, y, low, high, bottom, right) {
    ctx.font = '12px system-ui, sans-serif';
    ctx.fillStyle = colour('--ink');
    ctx.strokeStyle = colour('--rule');
    ctx.textAlign = 'left';
    ctx.textBaseline = 'middle';
    ctx.fillText(this.source.title, LEFT, 0.5 * TITLE);
    ctx.textAlign = 'right';
    const named = this.source.ticks;
    const [values, decimals] = named ? [named.map((_, i) => i), 0]
      : ticks(low, high, this.source.height / 26);
    for (const value of values) {
      ctx.beginPath();
      ctx.moveTo(LEFT, y(value));
      ctx.lineTo(right, y(value));
      ctx.stroke();
      ctx.fillText(named ? named[value] : value.toFixed(decimals), LEFT - 6, y(value));
    }
    const [start, end] = this.group.range;
    const [times, digits] = ticks(start, end, Math.max(3, (right - LEFT) / 90));
    ctx.textAlign = 'center';
    for (const time of times) {
      ctx.beginPath();
      ctx.moveTo(this.x(time), TITLE);
      ctx.lineTo(this.x(time), bottom);
      ctx.stroke();
      if (this.last) ctx.fillText(time.toFixed(digits), this.x(time), bottom + 10);
    }
    if (this.last) ctx.fillText('time [s]', 0.5 * (LEFT + right), bottom + 25);
    ctx.strokeStyle = colour('--soft');
    ctx.strokeRect(LEFT, TITLE, right - LEFT, this.source.height);
  }

  line(ctx, curve, y) {
    const style = PAGE.styles[curve.s] || {}, strong = this.strong(curve);
    const [first, last] = curve.between(...this.group.range);
    const dense = last - first > 2 * this.width;
    ctx.globalAlpha = strong ? 1 : 0.2;
    ctx.strokeStyle = ctx.fillStyle = colour(
      curve.kind === 'reference' ? '--reference' : curve.kind === 'measured' ? '--ink' : style.colour);
    ctx.lineWidth = curve.kind === 'reference' ? 3 : strong && !dense ? 1.6 : 1;
    ctx.setLineDash(dense ? [] : style.dash || []);
    if (curve.kind === 'band') return this.band(ctx, curve, y, first, last, strong);
    ctx.beginPath();
    let open = false, column = NaN, low = Infinity, high = -Infinity, level = NaN, count = 0;
    const flush = () => {
      if (!(low <= high)) return;
      const ends = Math.abs(low - level) < Math.abs(high - level) ? [low, high] : [high, low];
      for (const value of low === high ? [low] : ends) {
        if (curve.kind === 'step' && open) ctx.lineTo(column, y(level));
        if (open) ctx.lineTo(column, y(value)); else ctx.moveTo(column, y(value));
        open = true;
        count++;
      }
      level = low === high ? low : ends[1];
      low = Infinity;
      high = -Infinity;
    };
    for (let i = first; i < last; i++) {
      const exact = this.x(curve.time(i)), at = dense ? Math.round(exact) : exact;
      if (at !== column) { flush(); column = at; }
      const least = curve.low(i), most = curve.high(i);
      if (!(least <= most)) { flush(); open = false; continue; }
      if (least < low) low = least;
      if (most > high) high = most;
    }
    flush();
    ctx.stroke();
    ctx.globalAlpha = 1;
    this.points[curve.s || curve.kind] = count;
  }

  band(ctx, curve, y, first, last, strong) {
    ctx.globalAlpha = strong ? 0.2 : 0;
    const at = i => this.x(curve.time(i));
    for (let i = first; i < last;) {  // each part without gaps
      let end = i;
      while (end < last && curve.high(end) === curve.high(end)) end++;
      if (end > i) {
        ctx.beginPath();
        for (let k = i; k < end; k++) ctx.lineTo(at(k), y(curve.high(k)));
        for (let k = end - 1; k >= i; k--) ctx.lineTo(at(k), y(-curve.high(k)));
        ctx.fill();
      }
      i = end + 1;
    }
    ctx.globalAlpha = 1;
  }
}

class Group {
  constructor(element, source) {
    this.element = element;
    this.whole = [source.start, source.end];
    this.range = this.whole;
    this.finest = source.finest * NARROWEST;
    this.tools();
    this.panels = source.panels.map((each, i) => new Panel(this, each, i === source.panels.length - 1));
    this.box = document.createElement('div');
    this.box.className = 'box';
    this.box.hidden = true;
    element.append(this.box);
    for (const panel of this.panels) this.listen(panel);
    this.seen = false;
    new IntersectionObserver(found => {
      this.seen = found.some(each => each.isIntersecting);
      if (this.seen && this.stale !== false) this.draw();
    }, {rootMargin: '400px'}).observe(element);
  }
  tools() {
    const bar = document.createElement('div');
    bar.className = 'tools';
    const zoom = factor => () => this.around(0.5 * (this.range[0] + this.range[1]), factor);
    const shift = part => () => this.move(part * (this.range[1] - this.range[0]));
    for (const [text, name, action] of [['+', 'zoom in', zoom(0.5)], ['−', 'zoom out', zoom(2)],
      ['◀', 'earlier', shift(-0.4)], ['▶', 'later', shift(0.4)], ['all', 'whole record', () => this.go(...this.whole)]]) {
      const button = document.createElement('button');
      Object.assign(button, {textContent: text, title: name, onclick: action});
      button.setAttribute('aria-label', name);
      bar.append(button);
    }
    this.element.append(bar);
  }
  draw() {
    this.stale = !this.seen;
    if (this.seen) for (const panel of this.panels) panel.draw();
  }
  later() {  // once per frame
    this.stale = true;
    this.frame ??= requestAnimationFrame(() => { this.frame = undefined; this.draw(); });
  }
  go(start, end) {
    const [first, last] = this.whole;
    const length = Math.max(end - start, this.finest);
    const from = Math.min(Math.max(0.5 * (start + end - length), first), last - length);
    this.range = length < last - first ? [from, from + length] : this.whole;
    this.later();
  }
  around(time, factor) {
    const [start, end] = this.range;
    this.go(time - factor * (time - start), time + factor * (end - time));
  }
  move(by) { this.go(this.range[0] + by, this.range[1] + by); }
  listen(panel) {
    const canvas = panel.canvas;
    const time = event => {
      const [start, end] = this.range, x = event.clientX - canvas.getBoundingClientRect().left;
      const part = (x - LEFT) / (panel.width - LEFT - RIGHT);
      return start + Math.min(1, Math.max(0, part)) * (end - start);
    };
    let from = null, last = 0;
    canvas.addEventListener('pointerdown', event => {
      from = time(event);
      last = event.clientX;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener('pointermove', event => {
      if (from === null) return;
      if (event.pointerType === 'touch') {  // a vertical swipe scrolls the page, a horizontal one moves
        this.move((last - event.clientX) / panel.width * (this.range[1] - this.range[0]));
        last = event.clientX;
        return;
      }
      const [left, right] = [panel.x(from), panel.x(time(event))].sort((a, b) => a - b);
      Object.assign(this.box.style, {left: left + 'px', width: right - left + 'px',
        top: canvas.offsetTop + TITLE + 'px', height: panel.source.height + 'px'});
      this.box.hidden = false;
    });
    const end = event => {
      if (from === null) return;
      const [start, stop] = [from, time(event)].sort((a, b) => a - b);
      from = null;
      this.box.hidden = true;
      const pixels = (stop - start) / (this.range[1] - this.range[0]) * panel.width;
      if (event.type === 'pointerup' && event.pointerType !== 'touch' && pixels > 6) this.go(start, stop);
    };
    canvas.addEventListener('pointerup', end);
    canvas.addEventListener('pointercancel', end);
    canvas.addEventListener('dblclick', () => this.go(...this.whole));
    canvas.addEventListener('wheel', event => {
      if (!event.ctrlKey && !event.shiftKey) return;  // the page scrolls
      event.preventDefault();
      this.around(time(event), 1.0015 ** (event.deltaY || event.deltaX));
    }, {passive: false});
  }
}

const groups = PAGE.groups.map((each, i) => new Group(document.getElementById('group_' + i), each));

function choose() {
  for (const button of document.querySelectorAll('.legend button'))
    button.setAttribute('aria-pressed', chosen.has(button.dataset.s));
  for (const element of document.querySelectorAll('svg.plot [data-s]'))
    element.classList.toggle('faint', !chosen.has(element.dataset.s));
  for (const group of groups) group.later();
}
for (const button of document.querySelectorAll('.legend button'))
  button.onclick = () => {
    if (!chosen.delete(button.dataset.s)) chosen.add(button.dataset.s);
    choose();
  };
for (const button of document.querySelectorAll('button.copy'))
  button.onclick = async () => {
    const text = button.parentElement.querySelector('pre').textContent;
    try { await navigator.clipboard.writeText(text); button.textContent = 'copied'; }
    catch { getSelection().selectAllChildren(button.parentElement.querySelector('pre')); }
  };
addEventListener('resize', () => groups.forEach(group => group.later()));
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', choose);
choose();
