'use strict';
// The page is whole without this: it only turns the view in space and reads values off the curves.
const root = document.documentElement;
window.onerror = (what, _, line) => { root.dataset.error = what + ' (line ' + line + ')'; };

// --- values under the pointer ---------------------------------------------------------------------------------------

const plots = [...document.querySelectorAll('.plot')].map(plot => {
  const [span, low, high] = ['span', 'low', 'high'].map(key => Number(plot.dataset[key]));
  const value = y => plot.dataset.log === '1' ? low * (high / low) ** (1 - y / 300) : low + (high - low) * (1 - y / 300);
  const lines = [...plot.querySelectorAll('path.line')].map(path => {
    const numbers = (path.getAttribute('d').match(/-?[\d.]+/g) || []).map(Number);
    const points = [];
    for (let i = 0; i + 1 < numbers.length; i += 2) points.push([numbers[i] / 1000 * span, value(numbers[i + 1])]);
    return { name: path.dataset.name, points };
  });
  return { plot, span, lines, cursor: plot.querySelector('.cursor'), readout: plot.parentNode.querySelector('.readout') };
});
const digits = value => {
  const size = Math.abs(value);
  return size === 0 ? '0' : size < 1e-3 ? value.toExponential(1) : size < 0.1 ? value.toFixed(4) : size < 10 ? value.toFixed(2) : value.toFixed(1);
};
function nearest(points, time) {
  let [from, to] = [0, points.length - 1];
  while (to - from > 1) { const middle = (from + to) >> 1; if (points[middle][0] < time) from = middle; else to = middle; }
  const best = [points[from], points[to]].filter(Boolean).sort((a, b) => Math.abs(a[0] - time) - Math.abs(b[0] - time))[0];
  return best;
}
function point(time) {
  for (const { span, lines, cursor, readout } of plots) {
    const inside = time !== null && time >= 0 && time <= span;
    cursor.style.display = inside ? 'block' : 'none';
    if (!inside) { readout.textContent = ''; continue; }
    cursor.style.left = 100 * time / span + '%';
    const said = lines.map(line => [line.name, nearest(line.points, time)]).filter(([, at]) => at && Math.abs(at[0] - time) < 0.02 * span + 0.2);
    const names = lines.length > 1;
    readout.textContent = time.toFixed(1) + ' s: ' + said.map(([name, at]) => (names ? name + ' ' : '') + digits(at[1])).join(', ');
  }
}
for (const { plot, span } of plots) {
  plot.addEventListener('pointermove', event => {
    const box = plot.getBoundingClientRect();
    point((event.clientX - box.left) / box.width * span);
  });
  plot.addEventListener('pointerleave', () => point(null));
}

// --- the view in space ----------------------------------------------------------------------------------------------

const canvas = document.getElementById('view');
if (canvas) {
  const scene = JSON.parse(document.getElementById('scene').textContent);
  const metres = curve => curve.map(p => p.map(v => v / 1000));
  const way = metres(scene.way), truth = metres(scene.truth);
  const points = scene.points.map(([p, kind]) => [...p.map(v => v / 1000), kind]);
  const planes = scene.planes.map(plane => ({ ...plane, corners: metres(plane.corners) }));
  const kinds = ['point', 'floor', 'wall', 'ceiling', 'table', 'other'];
  const show = { truth: true, points: true, planes: true };
  // The middle and the size of what is known well; stray points far away do not count.
  const known = [...way, ...truth];
  const ends = (points, k) => points.reduce(([a, b], p) => [Math.min(a, p[k]), Math.max(b, p[k])], [Infinity, -Infinity]);
  const flown = [0, 1, 2].map(k => ends(known, k)), room = 0.7 * Math.max(0.1, ...flown.map(([a, b]) => b - a));
  // Planes count as far as they are near the way.
  const corners = planes.flatMap(plane => plane.corners).map(p => p.map((v, k) => Math.max(flown[k][0] - room, Math.min(flown[k][1] + room, v))));
  const box = [0, 1, 2].map(k => ends([...known, ...corners], k)), low = box.map(b => b[0]), high = box.map(b => b[1]);
  const middle = low.map((v, k) => known.length ? (v + high[k]) / 2 : 0);
  const size = known.length ? Math.max(0.3, Math.hypot(...high.map((v, k) => v - low[k]))) : 1;
  const home = { heading: -0.9, height: 0.55, zoom: 1 };
  const eye = { ...home };

  function draw() {
    const [width, height] = [canvas.clientWidth, canvas.clientHeight], dots = window.devicePixelRatio || 1;
    canvas.width = width * dots; canvas.height = height * dots;
    const pen = canvas.getContext('2d');
    pen.scale(dots, dots);
    pen.lineJoin = pen.lineCap = 'round';
    const style = getComputedStyle(root), color = name => style.getPropertyValue('--' + name).trim();
    const [ch, sh, cv, sv] = [Math.cos(eye.heading), Math.sin(eye.heading), Math.cos(eye.height), Math.sin(eye.height)];
    const scale = 0.95 * Math.min(width, height * 1.6) / size * eye.zoom, far = 2.5 * size;
    // Turned about the vertical, tilted, and a little smaller with distance.
    const at = p => {
      const [x, y, z] = [p[0] - middle[0], p[1] - middle[1], p[2] - middle[2]];
      const [right, ahead] = [ch * x + sh * y, -sh * x + ch * y];
      const depth = cv * ahead - sv * z, near = far / Math.max(0.2 * far, far + depth);
      return [width / 2 + scale * right * near, height / 2 - scale * (sv * ahead + cv * z) * near];
    };
    const curve = (corners, ink, thick) => {
      pen.beginPath();
      let before = null;
      for (const p of corners) {
        const [x, y] = at(p);
        // A new start of the estimator is no line.
        if (before && Math.hypot(p[0] - before[0], p[1] - before[1], p[2] - before[2]) < 0.2 * size) pen.lineTo(x, y); else pen.moveTo(x, y);
        before = p;
      }
      pen.strokeStyle = ink; pen.lineWidth = thick; pen.stroke();
    };
    // A grid at the height of the lowest thing.
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50].find(step => size / step < 16) || 100;
    const from = k => Math.floor(low[k] / step) * step, to = k => Math.ceil(high[k] / step) * step;
    if (known.length) {
      for (let x = from(0); x <= to(0) + step / 2; x += step) curve2([x, from(1), low[2]], [x, to(1), low[2]]);
      for (let y = from(1); y <= to(1) + step / 2; y += step) curve2([from(0), y, low[2]], [to(0), y, low[2]]);
    }
    function curve2(a, b) {
      pen.beginPath(); pen.moveTo(...at(a)); pen.lineTo(...at(b)); pen.strokeStyle = color('faint'); pen.lineWidth = 1; pen.stroke();
    }
    if (show.planes) for (const plane of planes) {
      pen.beginPath();
      plane.corners.forEach((p, i) => i ? pen.lineTo(...at(p)) : pen.moveTo(...at(p)));
      pen.closePath();
      pen.fillStyle = pen.strokeStyle = color(plane.class);
      pen.globalAlpha = 0.13; pen.fill(); pen.globalAlpha = 0.9; pen.lineWidth = 1.2; pen.stroke(); pen.globalAlpha = 1;
    }
    if (show.points) for (const p of points) {
      const [x, y] = at(p);
      pen.fillStyle = color(kinds[p[3]]); pen.globalAlpha = p[3] ? 0.75 : 0.5;
      pen.fillRect(x - 1, y - 1, 2, 2);
    }
    pen.globalAlpha = 1;
    if (show.truth) curve(truth, color('truth'), 4);
    curve(way, color('c1'), 1.8);
    if (way.length) [way[0], way[way.length - 1]].forEach((p, last) => {
      const [x, y] = at(p);
      pen.beginPath(); pen.arc(x, y, 4.5, 0, 7); pen.fillStyle = last ? color('c1') : color('paper'); pen.fill();
      pen.strokeStyle = color('c1'); pen.lineWidth = 2; pen.stroke();
    });
    if (show.planes) for (const plane of planes) {
      const center = [0, 1, 2].map(k => plane.corners.reduce((sum, p) => sum + p[k], 0) / Math.max(1, plane.corners.length));
      pen.fillStyle = color(plane.class); pen.font = '12px system-ui, sans-serif'; pen.textAlign = 'center';
      pen.fillText(plane.name, ...at(center));
    }
    pen.textAlign = 'left'; pen.fillStyle = color('soft'); pen.font = '12px system-ui, sans-serif';
    pen.fillText('grid ' + step + ' m', 10, height - 10);
  }

  let asked = false;
  const redraw = () => { if (!asked) { asked = true; requestAnimationFrame(() => { asked = false; draw(); }); } };
  const turn = (right, up) => { eye.heading += right; eye.height = Math.max(-0.2, Math.min(Math.PI / 2, eye.height + up)); redraw(); };
  const zoom = factor => { eye.zoom = Math.max(0.3, Math.min(12, eye.zoom * factor)); redraw(); };
  const fingers = new Map();
  canvas.addEventListener('pointerdown', event => { canvas.setPointerCapture(event.pointerId); fingers.set(event.pointerId, event); });
  for (const kind of ['pointerup', 'pointercancel']) canvas.addEventListener(kind, event => fingers.delete(event.pointerId));
  canvas.addEventListener('pointermove', event => {
    const before = fingers.get(event.pointerId);
    if (!before) return;
    const other = [...fingers.values()].find(finger => finger.pointerId !== event.pointerId);
    if (other) {
      const apart = finger => Math.hypot(finger.clientX - other.clientX, finger.clientY - other.clientY);
      zoom(apart(event) / Math.max(1, apart(before)));
    } else turn((event.clientX - before.clientX) * -0.008, (event.clientY - before.clientY) * 0.008);
    fingers.set(event.pointerId, event);
  });
  canvas.addEventListener('wheel', event => { event.preventDefault(); zoom(Math.exp(-event.deltaY * 0.0015)); }, { passive: false });
  canvas.addEventListener('keydown', event => {
    const keys = { ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0), ArrowUp: () => turn(0, 0.1), ArrowDown: () => turn(0, -0.1),
      '+': () => zoom(1.2), '-': () => zoom(1 / 1.2) };
    if (keys[event.key]) { event.preventDefault(); keys[event.key](); }
  });
  const views = { home, top: { heading: 0, height: Math.PI / 2, zoom: 1 }, side: { heading: 0, height: 0, zoom: 1 } };
  for (const button of document.querySelectorAll('[data-view]')) button.addEventListener('click', () => { Object.assign(eye, views[button.dataset.view]); redraw(); });
  for (const box of document.querySelectorAll('[data-show]')) box.addEventListener('change', () => { show[box.dataset.show] = box.checked; redraw(); });
  new ResizeObserver(redraw).observe(canvas);
  matchMedia('(prefers-color-scheme: dark)').addEventListener('change', redraw);
  draw();
}
root.dataset.ready = '1';
