/* ---- one rollout ---- */
const NOTHING = { predictions: '', choice: '', active: '', viable: '', reason: '', verdict: '', field: '', skills: [] };
const course = new Course({ ...DATA.motion, ...NOTHING, names: DATA.palette });
course.active = new Uint8Array(course.ticks);

document.title = DATA.title;
document.getElementById('title').textContent = DATA.title;
document.getElementById('repeat').append('Repeats exactly with ', element('code', {}, DATA.command), `; vocaloco ${DATA.version}.`);
const canvas = element('canvas', { class: 'scene', role: 'img', 'aria-label': DATA.title });
const button = element('button', { type: 'button' }, 'Play'), clock = element('output');
const slider = element('input', { type: 'range', min: 0, max: course.ticks - 1, value: 0, 'aria-label': 'time' });
const speed = element('select', { 'aria-label': 'speed' });
for (const v of [0.1, 0.25, 0.5, 1]) speed.append(element('option', v === 0.5 ? { value: v, selected: '' } : { value: v }, `${v}×`));
document.getElementById('stage').append(canvas, element('div', { class: 'controls' }, button, slider, clock, speed));
const scene = new Scene(canvas, course);
let tick = 0, exact = 0, last = null, playing = false;

function show(k) {
  tick = k; slider.value = k;
  clock.textContent = `${(k * course.tick_s).toFixed(2)} / ${course.end_s.toFixed(2)} s`;
  scene.draw(k);
}
function play(on) {
  playing = on; last = null; button.textContent = on ? 'Pause' : 'Play';
  if (!on) return;
  exact = tick >= course.ticks - 1 ? 0 : tick;
  requestAnimationFrame(advance);
}
function advance(now) {
  if (!playing) return;
  if (last != null) exact += Math.min(0.1, (now - last) / 1000) * +speed.value / course.tick_s;
  last = now;
  show(Math.min(course.ticks - 1, Math.floor(exact)));
  if (tick >= course.ticks - 1) play(false); else requestAnimationFrame(advance);
}
button.addEventListener('click', () => play(!playing));
slider.addEventListener('input', () => { play(false); show(+slider.value); });
function redraw() { readTheme(); show(tick); }
addEventListener('resize', redraw);
matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
show(0);
if (!calm) play(true);
