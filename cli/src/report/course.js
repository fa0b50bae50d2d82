'use strict';
const DATA = JSON.parse(document.getElementById('data').textContent);
const calm = matchMedia('(prefers-reduced-motion: reduce)').matches;
const DASHES = ['', '7 3', '2 2.5', '9 3 2 3', '4 2', '1 2'];
const NONE = 65535;

const theme = {};
function readTheme() {
  const style = getComputedStyle(document.documentElement);
  for (const name of ['paper', 'ink', 'faint', 'line', 'sky', 'ground', 'ground-side', 'ground-line', 'shadow', 'limb',
    'limb-far', 'stop', 'stand', 'skill-0', 'skill-1', 'skill-2', 'skill-3', 'skill-4', 'skill-5'])
    theme[name] = style.getPropertyValue('--' + name).trim();
}
readTheme();

function bytes(text) { return Uint8Array.from(atob(text), c => c.charCodeAt(0)); }
function words(text, Kind) {
  const raw = bytes(text), view = new DataView(raw.buffer), out = new Kind(raw.length / 2);
  for (let i = 0; i < out.length; i++) out[i] = Kind === Int16Array ? view.getInt16(2 * i, true) : view.getUint16(2 * i, true);
  return out;
}
function element(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  node.append(...children);
  return node;
}
function drawn(tag, attributes = {}, text) {
  const node = document.createElementNS('http://www.w3.org/2000/svg', tag);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== undefined) node.textContent = text;
  return node;
}
const number = (value, digits) => value == null ? '–' : value.toFixed(digits);

/* ---- small vectors ---- */
const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = a => { const n = Math.hypot(...a); return [a[0] / n, a[1] / n, a[2] / n]; };
function turn(q, v) { // v + 2u×(u×v + wv)
  const u = [q[0], q[1], q[2]], t = cross(u, v), s = cross(u, [t[0] + q[3] * v[0], t[1] + q[3] * v[1], t[2] + q[3] * v[2]]);
  return [v[0] + 2 * s[0], v[1] + 2 * s[1], v[2] + 2 * s[2]];
}
const FACES = [[0, 1, 3, 2, 0], [4, 6, 7, 5, 1], [0, 4, 5, 1, 2], [2, 3, 7, 6, 3], [0, 2, 6, 4, 4], [1, 5, 7, 3, 5]];
const NORMALS = [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]];
function corners(half) {
  const out = [];
  for (const x of [-1, 1]) for (const y of [-1, 1]) for (const z of [-1, 1]) out.push([x * half[0], y * half[1], z * half[2]]);
  return out;
}

/* ---- one course: its data, unpacked ---- */
class Course {
  constructor(raw) {
    Object.assign(this, raw);
    this.motion = words(raw.motion, Int16Array);
    this.predictions = words(raw.predictions, Uint16Array);
    this.choice = bytes(raw.choice); this.active = bytes(raw.active);
    this.viable = bytes(raw.viable); this.contact = bytes(raw.contact);
    this.reason = words(raw.reason, Uint16Array); this.verdict = words(raw.verdict, Uint16Array);
    this.field = new Int8Array(bytes(raw.field).buffer);
    this.stride = 7 + this.legs * this.leg_points * 3;
    this.end_s = (this.ticks - 1) * this.tick_s;
    this.climbs = this.base(this.ticks - 1)[2] - this.base(0)[2];
  }
  base(k) { const o = k * this.stride; return [0, 1, 2].map(i => this.motion[o + i] / 1000); }
  orientation(k) { const o = k * this.stride + 3; return [0, 1, 2, 3].map(i => this.motion[o + i] / 32767); }
  point(k, leg, joint) {
    const o = k * this.stride + 7 + (leg * this.leg_points + joint) * 3;
    return [this.motion[o] / 1000, this.motion[o + 1] / 1000, this.motion[o + 2] / 1000];
  }
  viability(k, s) { const v = this.predictions[(k * this.skills.length + s) * 2]; return v === NONE ? null : v / 1e4; }
  cost(k, s) { const v = this.predictions[(k * this.skills.length + s) * 2 + 1]; return v === NONE ? null : v / 1e3; }
  isViable(k, s) { return (this.viable[k] >> s & 1) === 1; }
  height(x, y) {
    let top = -Infinity;
    for (const [cx, cy, cz, hx, hy, hz] of this.terrain)
      if (Math.abs(x - cx) <= hx && Math.abs(y - cy) <= hy) top = Math.max(top, cz + hz);
    return top;
  }
  colour(name) {
    if (name === 'stop' || name === 'stand') return theme[name];
    return theme['skill-' + Math.max(0, DATA.palette.indexOf(name)) % 6];
  }
  dash(name) { return DASHES[Math.max(0, DATA.palette.indexOf(name)) % 6]; }
}
