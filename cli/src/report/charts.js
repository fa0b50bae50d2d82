/* ---- the heightfield that the networks see ---- */
const LOW = [33, 102, 172], MIDDLE = [245, 245, 242], HIGH = [179, 88, 6];
function tint(metres) {
  const t = Math.min(1, Math.abs(metres)), end = metres < 0 ? LOW : HIGH;
  return `rgb(${MIDDLE.map((m, i) => Math.round(m + (end[i] - m) * Math.sqrt(t))).join()})`;
}
function drawField(canvas, course, k) {
  const ratio = Math.min(2, devicePixelRatio || 1), width = Math.round(canvas.getBoundingClientRect().width * ratio) || 310;
  const cell = width / 31, bar = 12 * ratio, text = 12 * ratio;
  const height = Math.round(cell * 11 + 3.2 * text + bar);
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width; canvas.height = height; canvas.style.aspectRatio = `${width} / ${height}`;
  }
  const g = canvas.getContext('2d'), frame = Math.floor(k / course.field_every) * 341;
  g.clearRect(0, 0, width, height);
  for (let i = 0; i < 31; i++) for (let j = 0; j < 11; j++) {
    g.fillStyle = tint(course.field[frame + i * 11 + j] / 100);
    g.fillRect(Math.floor(i * cell), Math.floor(j * cell), Math.ceil(cell), Math.ceil(cell));
  }
  g.strokeStyle = '#17191c'; g.lineWidth = 2 * ratio;
  g.strokeRect((10.5 - 4.5) * cell, (5.5 - 1.6) * cell, 9 * cell, 3.2 * cell);
  g.beginPath(); g.moveTo(16 * cell, 4.5 * cell); g.lineTo(17.2 * cell, 5.5 * cell); g.lineTo(16 * cell, 6.5 * cell); g.stroke();
  g.fillStyle = theme.faint; g.font = `${text}px system-ui, sans-serif`; g.textBaseline = 'top';
  const under = cell * 11 + 3 * ratio;
  for (const [x, label, align] of [[-1, '−1 m', 'left'], [0, '0', 'center'], [1, '1', 'center'], [2, '2 m ahead', 'right']]) {
    g.textAlign = align;
    g.fillText(label, x === -1 ? 0 : x === 2 ? width : (x * 10 + 10.5) * cell, under);
  }
  const y = under + 1.35 * text, left = 4.2 * text, right = width - 4.2 * text;
  for (let x = left; x < right; x += ratio) {
    g.fillStyle = tint(-1 + 2 * (x - left) / (right - left)); g.fillRect(x, y, ratio + 1, bar);
  }
  g.fillStyle = theme.faint; g.textAlign = 'right'; g.fillText('−1 m', left - 4 * ratio, y);
  g.textAlign = 'left'; g.fillText('+1 m', right + 4 * ratio, y);
}

/* ---- charts over time ---- */
const MARGIN = { left: 40, right: 10 };
class Charts {
  constructor(holder, course, seek) {
    this.holder = holder; this.course = course; this.cursors = [];
    this.legend = element('div', { class: 'legend' });
    this.plots = element('div');
    holder.append(this.legend, this.plots);
    const at = e => {
      const box = this.plots.getBoundingClientRect();
      const t = (e.clientX - box.left - MARGIN.left) / (box.width - MARGIN.left - MARGIN.right);
      seek(Math.round(Math.min(1, Math.max(0, t)) * (course.ticks - 1)), e.type !== 'pointermove' || e.buttons > 0);
    };
    this.plots.addEventListener('pointerdown', at);
    this.plots.addEventListener('pointermove', e => { if (e.pointerType === 'mouse' || e.buttons > 0) at(e); });
  }
  x(k) { return MARGIN.left + (this.width - MARGIN.left - MARGIN.right) * k / Math.max(1, this.course.ticks - 1); }
  frame(title, height, low, high, step, digits, withTime) {
    const bottom = withTime ? 34 : 8, svg = drawn('svg', { height: height + bottom + 6, role: 'img', 'aria-label': title });
    const y = v => 6 + height * (1 - (v - low) / (high - low));
    if (step) for (let v = low; v <= high + 1e-9; v += step) {
      svg.append(drawn('line', { class: 'grid', x1: MARGIN.left, x2: this.width - MARGIN.right, y1: y(v), y2: y(v) }));
      svg.append(drawn('text', { x: MARGIN.left - 6, y: y(v) + 4, 'text-anchor': 'end' }, v.toFixed(digits)));
    }
    svg.append(drawn('line', { class: 'axis', x1: MARGIN.left, x2: this.width - MARGIN.right, y1: 6 + height, y2: 6 + height }));
    if (withTime) {
      const most = Math.max(2, Math.floor((this.width - MARGIN.left) / 60));
      const every = [0.5, 1, 2, 5, 10, 20, 50].find(s => this.course.end_s / s <= most) || 100;
      for (let t = 0; t <= this.course.end_s + 1e-9; t += every) {
        const x = this.x(t / this.course.tick_s);
        svg.append(drawn('line', { class: 'axis', x1: x, x2: x, y1: 6 + height, y2: 10 + height }));
        svg.append(drawn('text', { x, y: height + 22, 'text-anchor': 'middle' }, String(t)));
      }
      svg.append(drawn('text', { x: this.width - MARGIN.right, y: height + 36, 'text-anchor': 'end' }, 'time (s)'));
    }
    this.plots.append(element('div', { class: 'chart-title' }, title), svg);
    return [svg, y];
  }
  curve(svg, y, value, strong, name) {
    const c = this.course, make = keep => {
      let path = '', pen = false;
      for (let k = 0; k < c.ticks; k++) {
        const v = value(k);
        if (v == null || !keep(k)) { pen = false; continue; }
        path += (pen ? 'L' : 'M') + this.x(k).toFixed(1) + ' ' + y(v).toFixed(1);
        pen = true;
      }
      return path;
    };
    const style = { stroke: c.colour(name), 'stroke-dasharray': c.dash(name) };
    if (strong) svg.append(drawn('path', { class: 'curve pale', d: make(() => true), ...style, 'stroke-dasharray': '' }));
    svg.append(drawn('path', { class: 'curve', d: make(strong || (() => true)), ...style }));
  }
  build() {
    const c = this.course;
    this.width = Math.max(200, this.holder.getBoundingClientRect().width);
    this.plots.replaceChildren(); this.legend.replaceChildren(); this.cursors = [];
    for (const skill of c.skills) {
      const key = drawn('svg', { width: 34, height: 12, style: 'width:34px' });
      key.append(drawn('line', { x1: 1, x2: 33, y1: 6, y2: 6, stroke: c.colour(skill.name), 'stroke-width': 2.5, 'stroke-dasharray': c.dash(skill.name) }));
      this.legend.append(element('span', {}, key, `${skill.name} (viable from ${skill.threshold})`));
    }
    const frames = c.skills.length ? this.predictions() : [];
    const [band] = this.frame('chosen each tick, and active after the window', 52, 0, 1, 0, 0, true);
    [['choice', c.choice, 6], ['active', c.active, 33]].forEach(([label, series, top]) => {
      band.append(drawn('text', { x: MARGIN.left - 4, y: top + 15, 'text-anchor': 'end', style: 'font-size:11px' }, label));
      for (let k = 0; k < c.ticks;) {
        let end = k;
        while (end < c.ticks && series[end] === series[k]) end++;
        const name = c.names[series[k]], x = this.x(k), w = Math.max(0.5, this.x(Math.min(end, c.ticks - 1)) - x);
        band.append(drawn('rect', { x, y: top, width: w, height: 22, fill: c.colour(name) }));
        if (w > name.length * 7.5 + 8) band.append(drawn('text', { class: 'band-label', x: x + w / 2, y: top + 15, 'text-anchor': 'middle' }, name));
        k = end;
      }
    });
    for (const [svg, height] of [...frames, [band, 52]]) {
      const line = drawn('line', { class: 'cursor', y1: 2, y2: height + 8 });
      svg.append(line); this.cursors.push(line);
    }
  }
  predictions() {
    const c = this.course;
    const [viability, yv] = this.frame('predicted viability (probability; dotted: threshold)', 130, 0, 1, 0.25, 2, false);
    for (const skill of c.skills)
      viability.append(drawn('line', { class: 'threshold', x1: MARGIN.left, x2: this.width - MARGIN.right, y1: yv(skill.threshold), y2: yv(skill.threshold), stroke: c.colour(skill.name) }));
    c.skills.forEach((skill, s) => this.curve(viability, yv, k => c.viability(k, s), null, skill.name));
    let most = 0.2;
    for (let k = 0; k < c.ticks; k++) c.skills.forEach((_, s) => { most = Math.max(most, c.cost(k, s) ?? 0); });
    const step = [0.1, 0.2, 0.25, 0.5, 1, 2, 5].find(v => most / v <= 5) || 10;
    const [cost, yc] = this.frame('predicted cost of transport (dimensionless; pale: not viable)', 110, 0, Math.ceil(most / step) * step, step, step < 0.3 ? 2 : 1, false);
    c.skills.forEach((skill, s) => this.curve(cost, yc, k => c.cost(k, s), k => c.isViable(k, s), skill.name));
    return [[viability, 130], [cost, 110]];
  }
  move(k) { const x = this.x(k); for (const line of this.cursors) { line.setAttribute('x1', x); line.setAttribute('x2', x); } }
}
