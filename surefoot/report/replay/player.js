// The time bar: one moment for all panes.

async function start() {
  const run = await load();
  byId("still").hidden = true;
  byId("replay").hidden = false;
  readTheme();
  const slider = byId("instant"), last = run.t.length - 1, play = byId("play");
  const clock = (i) => (run.by_number ? `${run.by_number} ${i + 1} of ${last + 1}` : `${run.t[i].toFixed(1)} s`);
  let moment = -1, playing = false, drawing = false, asked = 0, seconds = 0;

  const seek = (t) => { pause(); return show(Math.max(lastAt(run.t, t + 1e-9), 0)); };
  const top = new TopView(run);
  const pictures = run.panes.map((pane) => new PicturePane(pane));
  const gaze = run.gaze_map ? new GazePane(run.gaze_map, run) : null;
  const values = new Values(run), plots = run.series.map((series) => new Plot(series, run, seek));
  byId("plots-pane").hidden = !plots.length;
  const space = new Space(run);
  slider.max = String(last);
  const lowest = (id) => byId(id).lastElementChild.getBoundingClientRect().bottom; // of a column
  if (byId("map-pane").getBoundingClientRect().bottom > lowest("side")) byId("side").append(byId("space-pane"));
  await top.ready;

  async function draw() {
    asked += 1;
    if (drawing) return; // the drawing that is under way goes on to what was asked for last
    drawing = true;
    try {
      for (let answered = 0, done = -1; answered !== asked; root.dataset.drawn = String(done)) {
        answered = asked;
        done = moment;
        top.draw(done);
        byId("map").setAttribute("aria-label", `top view, ${clock(done)}: ${values.words(done)}`);
        values.draw(done);
        for (const plot of plots) plot.draw(done);
        if (gaze) gaze.draw(done);
        await Promise.all(pictures.map((pane) => pane.draw(done, clock)));
        space.draw(done);
      }
    } finally { drawing = false; }
  }

  function show(i) {
    moment = Math.min(Math.max(i, 0), last);
    slider.value = String(moment);
    const total = run.by_number ? "" : ` / ${run.t[last].toFixed(1)} s`;
    byId("clock").textContent = run.by_number ? clock(moment) : `${run.t[moment].toFixed(1)}${total}`;
    slider.setAttribute("aria-valuetext", `${clock(moment)}${run.why[moment] ? `, ${run.why[moment]}` : ""}`);
    return draw();
  }

  function pause() {
    playing = false;
    play.textContent = "▶";
    play.setAttribute("aria-label", "play");
  }

  function toggle() {
    if (playing) { pause(); return; }
    playing = true;
    play.textContent = "⏸";
    play.setAttribute("aria-label", "pause");
    if (moment === last) moment = 0;
    seconds = run.t[moment];
    let before = performance.now();
    const tick = (now) => {
      if (!playing) return;
      seconds += (now - before) / 1000 * Number(byId("speed").value);
      before = now;
      const next = lastAt(run.t, seconds);
      if (next !== moment) show(next);
      if (moment >= last) pause(); else requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
  }

  const again = () => { readTheme(); for (const plot of plots) plot.stored = null; return draw(); };
  const pick = (id) => { byId(id).checked = !byId(id).checked; again(); };
  const keys = {
    " ": toggle, ArrowRight: (many) => step(many), ArrowLeft: (many) => step(-many),
    Home: () => { pause(); show(0); }, End: () => { pause(); show(last); },
    f: () => pick("follow"), c: () => pick("confidence"),
    e: () => { const one = byId("ellipse"); one.selectedIndex = (one.selectedIndex + 1) % one.length; again(); },
  };
  const step = (many) => { pause(); show(moment + many); };
  document.addEventListener("keydown", (event) => {
    const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    const typing = event.target instanceof HTMLSelectElement || (event.key === " " && event.target instanceof HTMLInputElement && event.target.type === "checkbox");
    if (!action || typing || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    action(event.shiftKey ? 10 : 1);
  });
  play.addEventListener("click", toggle);
  play.addEventListener("keyup", (event) => { if (event.key === " ") event.preventDefault(); }); // the key was taken below
  slider.addEventListener("input", () => { pause(); show(Number(slider.value)); });
  byId("bar").addEventListener("submit", (event) => event.preventDefault());
  for (const id of ["follow", "confidence", "ellipse", "layer"]) byId(id).addEventListener("change", again);
  new ResizeObserver(again).observe(byId("stage"));
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  const linked = () => {
    const found = /[#&]t=([0-9.]+)/.exec(location.hash);
    return found ? seek(Number(found[1])) : null;
  };
  window.addEventListener("hashchange", linked);
  await (linked() || show(0));
  root.dataset.moments = String(last + 1);
  root.dataset.ready = "1";
}

start().catch((error) => {
  byId("still").hidden = false;
  byId("replay").hidden = true;
  root.dataset.failed = String(error);
});
