/* ---- the runs on the paper's page: built as they come near, since each holds charts of its own ---- */
const sections = [], holders = DATA.courses.map(raw => {
  const holder = element('div', { class: 'run' });
  holder.style.minHeight = '600px';
  document.getElementById('courses').append(holder);
  return [holder, raw];
});
const near = new IntersectionObserver(entries => {
  for (const entry of entries.filter(e => e.isIntersecting)) {
    near.unobserve(entry.target);
    const raw = holders.find(([holder]) => holder === entry.target)[1];
    entry.target.style.minHeight = '';
    sections.push(new Section(new Course(raw), entry.target));
  }
}, { rootMargin: '800px' });
for (const [holder] of holders) near.observe(holder);
function relayout() { readTheme(); sections.forEach(section => section.layout()); }
let pending = 0, knownWidth = innerWidth;
addEventListener('resize', () => {
  if (innerWidth === knownWidth) return; // phones resize in height while scrolling
  knownWidth = innerWidth; cancelAnimationFrame(pending); pending = requestAnimationFrame(relayout);
});
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', relayout);
