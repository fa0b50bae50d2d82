/* ---- the runs on the paper's page: built as they come near, since each holds charts of its own ---- */
const sections = [], holders = DATA.courses.map(raw => {
  const holder = element('div', { class: 'run' });
  holder.style.minHeight = '600px';
  document.getElementById('courses').append(holder);
  return [holder, raw];
});
function build(holder, raw) {
  if (!holder.style.minHeight) return;
  near.unobserve(holder);
  holder.style.minHeight = '';
  sections.push(new Section(new Course(raw), holder));
}
const near = new IntersectionObserver(entries => {
  for (const entry of entries.filter(e => e.isIntersecting))
    build(...holders.find(([holder]) => holder === entry.target));
}, { rootMargin: '800px' });
for (const [holder] of holders) near.observe(holder);
// Paper has no "comes near".
addEventListener('beforeprint', () => holders.forEach(([holder, raw]) => build(holder, raw)));
function relayout() { readTheme(); sections.forEach(section => section.layout()); }
let pending = 0, knownWidth = innerWidth;
addEventListener('resize', () => {
  if (innerWidth === knownWidth) return; // phones resize in height while scrolling
  knownWidth = innerWidth; cancelAnimationFrame(pending); pending = requestAnimationFrame(relayout);
});
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', relayout);
