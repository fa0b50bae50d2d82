/* ---- the robot in its terrain ---- */
class Scene {
  constructor(canvas, course) {
    this.canvas = canvas; this.course = course;
    this.azimuth = course.climbs < -0.05 ? -0.98 : -2.16; this.elevation = 0.38; this.distance = 3.1;
    let from = null;
    canvas.addEventListener('pointerdown', e => { from = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener('pointermove', e => {
      if (!from) return;
      this.azimuth -= (e.clientX - from[0]) * 0.008;
      if (e.pointerType === 'mouse') this.elevation = Math.min(1.4, Math.max(0.05, this.elevation + (e.clientY - from[1]) * 0.006));
      from = [e.clientX, e.clientY]; this.draw(this.k);
    });
    for (const end of ['pointerup', 'pointercancel']) canvas.addEventListener(end, () => { from = null; });
  }
  size() {
    const box = this.canvas.getBoundingClientRect(), ratio = Math.min(2, devicePixelRatio || 1);
    const w = Math.max(1, Math.round(box.width * ratio)), h = Math.max(1, Math.round(box.height * ratio));
    if (this.canvas.width !== w || this.canvas.height !== h) { this.canvas.width = w; this.canvas.height = h; }
    this.ratio = ratio;
  }
  aim(k) {
    const c = this.course, span = 20;
    let x = 0, y = 0, z = 0, n = 0;
    for (let i = Math.max(0, k - span); i <= Math.min(c.ticks - 1, k + span); i += 4) {
      const p = c.base(i); x += p[0]; y += p[1]; z += p[2]; n++;
    }
    const target = [x / n + 0.25, y / n, z / n - 0.12];
    const ce = Math.cos(this.elevation);
    this.eye = [target[0] + this.distance * ce * Math.cos(this.azimuth), target[1] + this.distance * ce * Math.sin(this.azimuth),
      target[2] + this.distance * Math.sin(this.elevation)];
    this.forward = unit(sub(target, this.eye));
    this.right = unit(cross(this.forward, [0, 0, 1]));
    this.up = cross(this.right, this.forward);
    this.focal = 1.25 * Math.min(this.canvas.width, this.canvas.height * 1.35);
  }
  view(p) { const d = sub(p, this.eye); return [dot(d, this.right), dot(d, this.up), dot(d, this.forward)]; }
  pixel(v) { return [this.canvas.width / 2 + this.focal * v[0] / v[2], this.canvas.height / 2 - this.focal * v[1] / v[2]]; }
  polygon(points, fill, stroke) { // clipped at the near plane, 0.2 m
    const near = 0.2, vs = points.map(p => this.view(p)), kept = [];
    vs.forEach((a, i) => {
      const b = vs[(i + 1) % vs.length];
      if (a[2] >= near) kept.push(a);
      if ((a[2] >= near) !== (b[2] >= near)) {
        const t = (near - a[2]) / (b[2] - a[2]);
        kept.push([a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]), near]);
      }
    });
    if (kept.length < 2) return;
    const g = this.context;
    g.beginPath();
    kept.forEach((v, i) => { const [x, y] = this.pixel(v); i ? g.lineTo(x, y) : g.moveTo(x, y); });
    if (points.length > 2) g.closePath();
    if (fill) { g.fillStyle = fill; g.fill(); }
    if (stroke) { g.strokeStyle = stroke; g.stroke(); }
  }
  line(a, b, colour, metres) {
    const va = this.view(a), vb = this.view(b);
    if (va[2] < 0.2 || vb[2] < 0.2) return;
    const g = this.context, pa = this.pixel(va), pb = this.pixel(vb);
    g.lineWidth = Math.max(1.5 * this.ratio, metres * this.focal / (0.5 * (va[2] + vb[2])));
    g.lineCap = 'round'; g.strokeStyle = colour;
    g.beginPath(); g.moveTo(...pa); g.lineTo(...pb); g.stroke();
  }
  ball(p, metres, fill, stroke) {
    const v = this.view(p);
    if (v[2] < 0.2) return;
    const g = this.context;
    g.beginPath(); g.arc(...this.pixel(v), Math.max(1, metres * this.focal / v[2]), 0, 7);
    g.fillStyle = fill; g.fill();
    if (stroke) { g.lineWidth = 1.5 * this.ratio; g.strokeStyle = stroke; g.stroke(); }
  }
  ground() {
    const g = this.context, boxes = [...this.course.terrain];
    // Boxes lie apart along x: the farther from the eye, the earlier.
    const away = b => Math.max(0, Math.abs(b[0] - this.eye[0]) - b[3]) + 1e-3 * Math.abs(b[0] - this.eye[0]);
    boxes.sort((a, b) => away(b) - away(a));
    const floor = Math.min(...boxes.map(b => b[2] + b[5])) - 0.12;
    for (const [cx, cy, cz, hx, hy, hz] of boxes) {
      const top = cz + hz, low = Math.max(cz - hz, floor);
      const at = corners([hx, hy, (top - low) / 2]).map(p => [p[0] + cx, p[1] + cy, p[2] + (top + low) / 2]);
      for (const [a, b, c, d, n] of FACES) {
        const centre = [cx + NORMALS[n][0] * hx, cy + NORMALS[n][1] * hy, n === 5 ? top : n === 4 ? low : (top + low) / 2];
        if (dot(NORMALS[n], sub(this.eye, centre)) <= 0) continue;
        g.lineWidth = this.ratio;
        this.polygon([at[a], at[b], at[c], at[d]], n === 5 ? theme.ground : theme['ground-side'], theme['ground-line']);
        if (n === 5) {
          g.globalAlpha = 0.45;
          for (let x = Math.ceil((cx - hx) * 2 + 1e-6) / 2; x < cx + hx; x += 0.5)
            this.polygon([[x, cy - hy, top], [x, cy + hy, top]], null, theme['ground-line']);
          for (let y = Math.ceil((cy - hy) * 2 + 1e-6) / 2; y < cy + hy; y += 0.5)
            this.polygon([[cx - hx, y, top], [cx + hx, y, top]], null, theme['ground-line']);
          g.globalAlpha = 1;
        }
      }
    }
  }
  trail(k) {
    const c = this.course;
    let last = null;
    for (let i = 0; i < c.ticks; i += 5) {
      const p = c.base(i), h = c.height(p[0], p[1]), here = [p[0], p[1], (Number.isFinite(h) ? h : 0) + 0.005];
      this.context.globalAlpha = i <= k ? 0.95 : 0.3;
      if (last) this.line(last, here, c.colour(c.names[c.active[i]]), 0.02);
      last = here;
    }
    this.context.globalAlpha = 1;
  }
  draw(k) {
    this.k = k; this.size(); this.aim(k);
    const g = this.context = this.canvas.getContext('2d'), c = this.course;
    g.lineJoin = 'round';
    g.fillStyle = theme.sky; g.fillRect(0, 0, this.canvas.width, this.canvas.height);
    this.ground(); this.trail(k);
    const position = c.base(k), q = c.orientation(k), body = c.colour(c.names[c.active[k]]);
    const place = p => { const r = turn(q, p); return [r[0] + position[0], r[1] + position[1], r[2] + position[2]]; };
    const parts = [];
    for (const [centre, half] of c.base_boxes) {
      const at = corners(half).map(p => place([p[0] + centre[0], p[1] + centre[1], p[2] + centre[2]]));
      const shade = at.filter((_, i) => i % 2 === 0).map(p => [p[0], p[1], c.height(p[0], p[1]) + 0.003]);
      if (shade.every(p => Number.isFinite(p[2]))) this.polygon([shade[0], shade[1], shade[3], shade[2]], theme.shadow, null);
      for (const [a, b, d, e, n] of FACES) {
        const normal = turn(q, NORMALS[n]), middle = place(NORMALS[n].map((v, i) => v * half[i] + centre[i]));
        if (dot(normal, sub(this.eye, middle)) <= 0) continue;
        const light = n === 5 ? 1 : n === 1 ? 0.62 : 0.8;
        parts.push([this.view(middle)[2], () => {
          g.lineWidth = this.ratio;
          this.polygon([at[a], at[b], at[d], at[e]], body, theme.paper);
          g.globalAlpha = 1 - light;
          this.polygon([at[a], at[b], at[d], at[e]], '#000', null);
          g.globalAlpha = 1;
        }]);
      }
    }
    const depths = [];
    for (let leg = 0; leg < c.legs; leg++) depths.push(this.view(c.point(k, leg, 0))[2]);
    const mean = depths.reduce((a, b) => a + b, 0) / c.legs;
    for (let leg = 0; leg < c.legs; leg++) {
      const colour = depths[leg] < mean ? theme.limb : theme['limb-far'];
      for (let j = 1; j < c.leg_points; j++) {
        const a = c.point(k, leg, j - 1), b = c.point(k, leg, j);
        const depth = this.view([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, (a[2] + b[2]) / 2])[2] + (depths[leg] < mean ? -0.3 : 0.3);
        const thick = j === c.leg_points - 1 ? 0.045 : 0.075;
        parts.push([depth, () => { this.line(a, b, colour, thick); this.ball(b, thick * 0.62, colour, null); }]);
      }
      const foot = c.point(k, leg, c.leg_points - 1), touching = (c.contact[k] >> leg & 1) === 1;
      parts.push([this.view(foot)[2] - (depths[leg] < mean ? 0.32 : -0.28),
        () => this.ball(foot, 0.036, touching ? theme.ink : theme.paper, theme.ink)]);
    }
    parts.sort((a, b) => b[0] - a[0]).forEach(part => part[1]());
    g.fillStyle = theme.faint; g.font = `${12 * this.ratio}px system-ui, sans-serif`;
    g.fillText('drag to turn', 8 * this.ratio, this.canvas.height - 9 * this.ratio);
  }
}
