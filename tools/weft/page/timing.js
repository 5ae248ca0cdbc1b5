// Table and timeline of the stages; `timing` as TimingReport says.
function timingTable(timing) {
  const cell = v => v.toFixed(1);
  const four = q => q.map(cell).map(t => `<td>${t}</td>`).join('');
  const rows = timing.stages.map(s =>
    `<tr><td>${text(s.name)}</td>${four(s.wait)}${four(s.work)}<td>${cell(s.cpu[0])}</td><td>${s.frames}</td></tr>`);
  const names = '<th>p50</th><th>p95</th><th>p99</th><th>max</th>';
  return `<table><thead><tr><th></th><th colspan="4">queue wait, ms</th><th colspan="4">work, ms</th><th>CPU, ms</th><th></th></tr>
    <tr><th>stage</th>${names}${names}<th>p50</th><th>frames</th></tr></thead><tbody>${rows.join('')}
    <tr><td>end to end</td><td></td><td></td><td></td><td></td>${four(timing.end_to_end)}<td></td><td>${timing.frames}</td></tr></tbody></table>`;
}

function text(value) {
  return String(value).replace(/[&<>"']/g, c => `&#${c.charCodeAt(0)};`);
}

function hue(frame) {
  return `hsl(${(frame * 67) % 360} 62% 52%)`;
}

// One row a stage; pale: waiting in the queue, solid: at work. Drag to move, wheel to zoom.
function timeline(element, timing) {
  if (!timing.spans.length) { element.textContent = 'No STAGE_TIMING messages.'; return; }
  const rowHeight = 26, left = 130, bottom = 24, width = 1400;
  const height = timing.stages.length * rowHeight + bottom;
  const end = Math.max(...timing.spans.map(s => s[5]));
  let from = 0, to = Math.min(end, timing.initial_ms);
  const draw = () => {
    const x = t => left + (t - from) / (to - from) * (width - left);
    let svg = '';
    const step = niceStep((to - from) / 10);
    for (let t = Math.ceil(from / step) * step; t <= to; t += step) {
      svg += `<line x1="${x(t)}" x2="${x(t)}" y1="0" y2="${height - bottom}" stroke="var(--line)"/>` +
        `<text x="${x(t)}" y="${height - 6}" text-anchor="middle">${+t.toFixed(3)} ms</text>`;
    }
    for (const [frame, stage, received, started, finished, published, status] of timing.spans) {
      if (published < from || received > to) continue;
      const y = stage * rowHeight;
      const bar = (a, b, h, o) => {
        const x1 = Math.max(x(a), left), x2 = Math.min(x(b), width);
        return x2 > x1 ? `<rect x="${x1}" width="${Math.max(x2 - x1, 0.7)}" y="${y + (rowHeight - h) / 2}" height="${h}" rx="2" fill="${status > 1 ? 'var(--bad)' : hue(frame)}" opacity="${o}"/>` : '';
      };
      svg += `<g><title>${text(timing.stages[stage].name)}, frame ${frame}: waited ${(started - received).toFixed(2)} ms, worked ${(finished - started).toFixed(2)} ms</title>` +
        bar(received, started, 8, 0.3) + bar(started, finished, 18, 1) + '</g>';
    }
    svg += `<rect width="${left - 4}" height="${height - bottom}" fill="var(--panel)"/>`;
    timing.stages.forEach((s, i) => { svg += `<text x="0" y="${i * rowHeight + 17}">${text(s.name)}</text>`; });
    element.innerHTML = `<svg class="timeline" viewBox="0 0 ${width} ${height}" width="100%">${svg}</svg>`;
  };
  const timeAt = event => {
    const box = element.getBoundingClientRect();
    const x = (event.clientX - box.left) / box.width * width;
    return from + (x - left) / (width - left) * (to - from);
  };
  element.onwheel = event => {
    event.preventDefault();
    const at = timeAt(event), factor = event.deltaY > 0 ? 1.25 : 0.8;
    from = Math.max(0, at - (at - from) * factor);
    to = Math.min(end, at + (to - at) * factor);
    draw();
  };
  element.onpointerdown = event => {
    element.setPointerCapture(event.pointerId);
    let last = timeAt(event);
    element.onpointermove = e => {
      const shift = Math.max(-from, Math.min(end - to, last - timeAt(e)));
      from += shift; to += shift;
      last = timeAt(e);
      draw();
    };
  };
  element.onpointerup = () => { element.onpointermove = null; };
  draw();
}

function niceStep(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return [1, 2, 5, 10].map(n => n * power).find(n => n >= step);
}
