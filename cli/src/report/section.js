/* ---- a course's section ---- */
class Section {
  constructor(course, holder) {
    this.course = course; this.k = 0; this.playing = false; this.seen = false; this.started = false;
    const s = course.steps, title = course.title;
    this.node = element('section', { id: course.id, 'data-tick': '0' });
    const summary = element('p');
    summary.textContent = course.summary;
    const canvas = element('canvas', { class: 'scene', role: 'img', 'aria-label': `The robot on ${title}, ${s} steps` });
    this.button = element('button', { type: 'button' }, 'Play');
    this.slider = element('input', { type: 'range', min: 0, max: course.ticks - 1, value: 0, 'aria-label': 'time' });
    this.clock = element('output');
    this.speed = element('select', { 'aria-label': 'speed' });
    for (const v of [0.25, 0.5, 1, 2]) this.speed.append(element('option', v === 1 ? { value: v, selected: '' } : { value: v }, `${v}×`));
    const left = element('div', {}, canvas, element('div', { class: 'controls' }, this.button, this.slider, this.clock, this.speed));
    this.headline = element('h3'); this.why = element('p'); this.table = element('table');
    this.fieldCanvas = element('canvas', { role: 'img', 'aria-label': 'heightfield around the robot, 31 by 11 points' });
    const right = element('div', { class: 'tick' }, this.headline, this.why, this.table,
      element('figure', { class: 'field' }, this.fieldCanvas, element('figcaption', {}, DATA.field_caption)));
    const charts = element('div', { class: 'charts' });
    if (!course.skills.length) right.classList.add('alone');
    this.node.append(element('h2', {}, title), summary, element('div', { class: 'stage' }, left, right), charts);
    holder.append(this.node);
    this.scene = new Scene(canvas, course);
    this.charts = new Charts(charts, course, (k, firm) => {
      if (firm) this.play(false);
      if (!this.playing) this.show(k);
    });
    this.verdicts();
    this.button.addEventListener('click', () => this.play(!this.playing));
    this.slider.addEventListener('input', () => { this.play(false); this.show(+this.slider.value); });
    new IntersectionObserver(entries => {
      this.seen = entries[entries.length - 1].isIntersecting;
      if (this.seen && !this.started && !calm) { this.started = true; this.play(true); }
    }, { threshold: 0.35 }).observe(canvas);
    this.layout();
  }
  verdicts() {
    const head = element('tr');
    for (const [text, kind] of [['skill', ''], ['viability', 'number'], ['threshold', 'number'], ['CoT', 'number'], ['', '']])
      head.append(element('th', { class: kind }, text));
    this.table.append(head);
    this.rows = this.course.skills.map(skill => {
      const name = element('td', {}, element('b', {}, skill.name)), v = element('td', { class: 'number' });
      const c = element('td', { class: 'number' }), mark = element('td'), why = element('td', { class: 'why', colspan: 5 });
      this.table.append(element('tr', { class: 'verdict' }, name, v, element('td', { class: 'number' }, String(skill.threshold)), c, mark), element('tr', {}, why));
      return { name, v, c, mark, why };
    });
  }
  layout() { this.charts.build(); this.show(this.k); }
  play(on) {
    this.playing = on; this.button.textContent = on ? 'Pause' : 'Play'; this.last = null;
    if (!on) return;
    if (this.k >= this.course.ticks - 1) this.k = 0;
    this.exact = this.k;
    requestAnimationFrame(now => this.advance(now));
  }
  advance(now) {
    if (!this.playing) return;
    if (this.last != null && this.seen) {
      this.exact += Math.min(0.1, (now - this.last) / 1000) * +this.speed.value / this.course.tick_s;
      this.show(Math.min(this.course.ticks - 1, Math.floor(this.exact)));
    }
    this.last = now;
    if (this.k >= this.course.ticks - 1) this.play(false);
    else requestAnimationFrame(later => this.advance(later));
  }
  show(k) {
    const c = this.course;
    this.k = k;
    this.node.dataset.tick = k;
    this.slider.value = k;
    this.clock.textContent = `${(k * c.tick_s).toFixed(2)} / ${c.end_s.toFixed(2)} s`;
    this.scene.draw(k); this.charts.move(k); drawField(this.fieldCanvas, c, k);
    const choice = c.names[c.choice[k]], active = c.names[c.active[k]];
    this.headline.textContent = `tick ${k + c.first_tick}: ${active} is active, ${choice} is chosen`;
    this.why.textContent = c.texts[c.reason[k]];
    this.rows.forEach((row, s) => {
      row.name.style.color = c.colour(c.skills[s].name);
      row.v.textContent = number(c.viability(k, s), 3);
      row.c.textContent = number(c.cost(k, s), 3);
      row.mark.textContent = c.isViable(k, s) ? '✓' : '✗';
      row.mark.className = c.isViable(k, s) ? 'good' : 'bad';
      row.why.textContent = c.texts[c.verdict[k * c.skills.length + s]];
    });
  }
}
