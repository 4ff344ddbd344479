'use strict';
// Curves over the time of a run, beside the scene.

const curvesFor = list => list.map(() => []);
const plots = [
  { title: 'contact force [N]', curves: curvesFor(stage.fingers), of: (f, k) => f.fingers[k].force },
  { title: 'contact area [mm²]', curves: curvesFor(stage.fingers), of: (f, k) => 1e6 * f.fingers[k].area },
  { title: 'matching residual [mm]', curves: curvesFor(stage.thimbles), of: (f, k) => 1e3 * f.thimbles[k].rms,
    colours: stage.thimbles.map(t => palette[t.finger % palette.length]) },
  { title: 'longest step [µs] (line: the time step)', curves: [[]], of: f => f.step_us, colours: ['#495057'],
    line: 1e6 * stage.dt },
].filter(plot => plot.curves.length > 0);
for (const plot of plots) {
  plot.canvas = document.createElement('canvas');
  plot.canvas.className = 'plot';
  by('plots').appendChild(plot.canvas);
  plot.most = 1e-9;
  plot.canvas.setAttribute('role', 'img');
  plot.canvas.setAttribute('aria-label', plot.title + ' over time');
  const frameAt = event => {
    const box = plot.canvas.getBoundingClientRect();
    const share = Math.min(1, Math.max(0, (event.clientX - box.left - 44) / (box.width - 52)));
    const first = frames[0].time, time = first + share * (frames[frames.length - 1].time - first);
    let k = 0;
    while (k + 1 < frames.length && Math.abs(frames[k + 1].time - time) <= Math.abs(frames[k].time - time)) ++k;
    return k;
  };
  plot.canvas.onmousemove = event => {
    if (frames.length === 0) return;
    const k = frameAt(event);
    by('hover').hidden = false;
    by('hover').innerHTML = `${frames[k].time.toFixed(3)} s<br>` + plot.curves.map((curve, c) =>
      `<span style="color:${plot.colours ? plot.colours[c] : palette[c % palette.length]}">${
        Number(curve[k]).toPrecision(4)}</span>`).join('<br>');
    Object.assign(by('hover').style, { left: event.clientX + 12 + 'px', top: event.clientY + 8 + 'px' });
  };
  plot.canvas.onmouseleave = () => { by('hover').hidden = true; };
  plot.canvas.onclick = event => { if (frames.length > 0) { play(false); show(frameAt(event)); } };
}

function drawPlots() {
  const style = getComputedStyle(document.body), ink = style.getPropertyValue('--ink'), soft = style.getPropertyValue('--soft');
  const border = style.getPropertyValue('--line');
  const t0 = frames[0].time, t1 = Math.max(t0 + 1e-6, frames[frames.length - 1].time);
  for (const plot of plots) {
    const c = plot.canvas, ratio = window.devicePixelRatio || 1, w = c.clientWidth, h = c.clientHeight;
    c.width = w * ratio, c.height = h * ratio;
    const g = c.getContext('2d');
    g.scale(ratio, ratio);
    const x = t => 44 + (w - 52) * (t - t0) / (t1 - t0), y = v => h - 16 - (h - 34) * v / plot.most;
    g.font = '11px system-ui, sans-serif';
    g.fillStyle = ink;
    g.fillText(plot.title, 44, 11);
    g.fillStyle = soft;
    g.textAlign = 'right';
    if (plot.most > 1e-6) g.fillText(plot.most.toPrecision(3), 40, y(plot.most) + 4);
    g.fillText('0', 40, y(0) + 4);
    g.fillText(t1.toFixed(2) + ' s', w - 8, h - 3);
    g.strokeStyle = border;
    g.strokeRect(44, y(plot.most), w - 52, y(0) - y(plot.most));
    if (plot.line <= plot.most) {
      g.strokeStyle = '#c62828';
      g.setLineDash([4, 3]);
      g.beginPath(); g.moveTo(44, y(plot.line)); g.lineTo(w - 8, y(plot.line)); g.stroke();
      g.setLineDash([]);
    }
    plot.curves.forEach((curve, k) => {
      g.strokeStyle = plot.colours ? plot.colours[k] : palette[k % palette.length];
      g.beginPath();
      curve.forEach((v, i) => i ? g.lineTo(x(frames[i].time), y(v)) : g.moveTo(x(frames[i].time), y(v)));
      g.stroke();
    });
    g.strokeStyle = ink;
    g.beginPath(); g.moveTo(x(frames[now].time), y(plot.most)); g.lineTo(x(frames[now].time), y(0)); g.stroke();
  }
}
