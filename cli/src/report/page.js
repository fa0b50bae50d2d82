/* ---- the page of a demo ---- */
function outcomes() {
  const table = document.getElementById('outcomes'), head = element('tr');
  for (const [text, kind] of [['course', ''], ['outcome', ''], ['expected', ''], ['time', 'number'], ['distance', 'number'], ['CoT', 'number'], ['active skills', '']])
    head.append(element('th', { class: kind }, text));
  table.append(head);
  const cell = (label, text, kind = '') => element('td', { 'data-label': label, class: kind }, text);
  for (const c of DATA.courses)
    table.append(element('tr', {}, element('td', {}, element('a', { href: '#' + c.id }, c.title)),
      element('td', { class: !c.expected ? '' : c.as_expected ? 'good' : 'bad' }, (!c.expected ? '' : c.as_expected ? '✓ ' : '✗ ') + c.outcome),
      cell('expected', c.expected ?? '–'), cell('time', number(c.duration_s, 1) + ' s', 'number'),
      cell('distance', number(c.distance_m, 2) + ' m', 'number'), cell('CoT', number(c.cot, 2), 'number'),
      element('td', {}, c.path)));
  document.getElementById('lead').textContent = DATA.lead;
  document.getElementById('repeat').append('Repeats exactly with ', element('code', {}, DATA.command), `; vocaloco ${DATA.version}, seed ${DATA.seed}, networks run by ${DATA.backend}.`);
}

outcomes();
const sections = DATA.courses.map(raw => new Section(new Course(raw), document.getElementById('courses')));
function relayout() { readTheme(); sections.forEach(section => section.layout()); }
let pending = 0, knownWidth = innerWidth;
addEventListener('resize', () => {
  if (innerWidth === knownWidth) return; // phones resize in height while scrolling
  knownWidth = innerWidth; cancelAnimationFrame(pending); pending = requestAnimationFrame(relayout);
});
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', relayout);
