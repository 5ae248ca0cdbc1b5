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

// What went wrong at each stage, and how often the frames' last answers waited for it.
function lossTable(timing) {
  const rows = timing.stages.map(s => `<tr><td>${text(s.name)}</td><td>${text(s.host)}</td>` +
    [s.failed, s.dropped, s.missing_input, s.gaps].map(n => `<td${n ? ' class="bad"' : ''}>${n}</td>`).join('') +
    `<td>${s.publish[0].toFixed(2)}</td><td>${(100 * s.critical_frames / timing.frames).toFixed(0)} %</td><td>${s.critical_ms.toFixed(1)}</td></tr>`);
  return `<table><thead><tr><th>stage</th><th>host</th><th>failed</th><th>dropped</th><th>missing input</th><th>gaps</th>
    <th>publish p50, ms</th><th>on the critical path of</th><th>for, ms a frame</th></tr></thead><tbody>${rows.join('')}
    <tr><td>between them</td><td></td><td></td><td></td><td></td><td></td><td></td><td></td><td>${timing.transport[0].toFixed(1)}</td></tr></tbody></table>`;
}

// The slowest frames, each as a bar of what its last answer waited for; a click shows it in the timeline.
function slowest(element, timing, show) {
  const most = Math.max(1e-6, ...timing.slowest.map(f => f.total));
  const kinds = [['way', 0.25], ['wait', 0.45], ['work', 1], ['publish', 0.7]];
  element.innerHTML = timing.slowest.map((f, i) => `<div class="slow" data-index="${i}"><span title="${text(f.name)}">frame ${text(f.name.split('/').pop())}</span><b>${f.total.toFixed(1)} ms</b><div class="bar">` +
    f.steps.map(([stage, ...parts]) => kinds.map(([kind, opacity], k) =>
      `<i style="width:${100 * parts[k] / most}%;background:${stageColour(stage)};opacity:${opacity}" title="${text(timing.stages[stage].name)}: ${kind} ${parts[k].toFixed(2)} ms"></i>`).join('')).join('') +
    '</div></div>').join('') + '<div class="legend">' + timing.stages.map((s, i) =>
      `<span><i style="background:${stageColour(i)}"></i>${text(s.name)}</span>`).join('') + '</div>';
  element.onclick = event => {
    const row = event.target.closest('.slow');
    if (row) show(timing.slowest[+row.dataset.index]);
  };
}

function stageColour(stage) {
  return `hsl(${(stage * 137 + 210) % 360} 60% 52%)`;
}

// One row a stage; pale: waiting in the queue, solid: at work, outlined: on the critical path. Drag to move, wheel
// to zoom. Returns show(begin, end).
function timeline(element, timing) {
  if (!timing.spans.length) { element.textContent = 'No STAGE_TIMING messages.'; return () => {}; }
  const rowHeight = 26, bottom = 24, width = 1400;
  const left = 20 + 7.2 * Math.max(8, ...timing.stages.map(s => s.name.length));
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
    for (const [frame, stage, received, started, finished, published, status, critical] of timing.spans) {
      if (published < from || received > to) continue;
      const y = stage * rowHeight;
      const bar = (a, b, h, o, edge) => {
        const x1 = Math.max(x(a), left), x2 = Math.min(x(b), width);
        return x2 > x1 ? `<rect x="${x1}" width="${Math.max(x2 - x1, 0.7)}" y="${y + (rowHeight - h) / 2}" height="${h}" rx="2" fill="${status > 1 ? 'var(--bad)' : hue(frame)}" opacity="${o}"${edge}/>` : '';
      };
      svg += `<g><title>${text(timing.stages[stage].name)}, frame ${frame}: waited ${(started - received).toFixed(2)} ms, worked ${(finished - started).toFixed(2)} ms, published in ${(published - finished).toFixed(2)} ms${critical ? '; on the critical path' : ''}</title>` +
        bar(received, started, 8, 0.3, '') + bar(started, finished, 18, 1, critical ? ' stroke="var(--ink)" stroke-width="1.5"' : '') + '</g>';
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
  return (begin, finish) => { from = Math.max(0, begin); to = Math.min(end, finish); draw(); };
}

function niceStep(step) {
  const power = 10 ** Math.floor(Math.log10(step));
  return [1, 2, 5, 10].map(n => n * power).find(n => n >= step);
}
