// The time bar: one moment for all panes, of a run that is over or still goes on.

async function start() {
  const run = root.dataset.live === undefined ? await load() : emptyRun();
  const live = root.dataset.live === undefined ? null : new Live(run);
  const slider = byId("instant"), play = byId("play"), newest = byId("newest");
  const clock = (i) => (run.by_number ? `${run.by_number} ${i + 1} of ${run.t.length}` : `${run.t[i].toFixed(1)} s`);
  const speed = () => Number(byId("speed").value) || 1; // 0: a live walk goes on as fast as it is computed
  let moment = -1, playing = Boolean(live), drawing = false, asked = 0, seconds = 0, stepping = false;

  while (live && !run.t.length) { await live.more(); byId("subtitle").textContent = live.words; }
  byId("still").hidden = true;
  byId("replay").hidden = false;
  readTheme();
  const last = () => run.t.length - 1;
  const seek = (t) => { halt(); return show(Math.max(lastAt(run.t, t + 1e-9), 0)); };
  const top = new TopView(run), pictures = [], plots = [], values = new Values(run);
  let gaze = null;
  complete();
  const space = new Space(run, pictures);
  const lowest = (id) => byId(id).lastElementChild.getBoundingClientRect().bottom; // of a column
  if (!live && byId("map-pane").getBoundingClientRect().bottom > lowest("side")) byId("side").append(byId("space-pane"));
  await top.ready;

  // A pane for everything that the run has.
  function complete() {
    slider.max = String(last());
    for (const pane of run.panes.slice(pictures.length)) pictures.push(new PicturePane(pane));
    for (const series of run.series.slice(plots.length)) plots.push(new Plot(series, run, seek));
    if (run.gaze_map && !gaze) gaze = new GazePane(run.gaze_map, run);
    byId("plots-pane").hidden = !plots.length;
    values.complete();
    top.complete();
  }

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
    moment = Math.min(Math.max(i, 0), last());
    slider.value = String(moment);
    tell();
    return draw();
  }

  function tell() {
    if (moment < 0) return; // nothing is shown yet
    const total = run.by_number ? "" : ` / ${run.t[last()].toFixed(1)} s`;
    byId("clock").textContent = run.by_number ? clock(moment) : `${run.t[moment].toFixed(1)}${total}`;
    slider.setAttribute("aria-valuetext", `${clock(moment)}${run.why[moment] ? `, ${run.why[moment]}` : ""}`);
    const label = playing ? "pause" : "play";
    if (play.getAttribute("aria-label") !== label) {
      play.textContent = playing ? "❚❚" : "▶";
      play.setAttribute("aria-label", label);
    }
    if (!live) return;
    newest.disabled = playing && moment === last();
    byId("subtitle").textContent = live.words;
    root.dataset.state = live.words;
  }

  // Stop playing; the walk goes on.
  function halt() { playing = false; tell(); }

  function pause() {
    halt();
    if (live) { live.command({ paused: true }); tell(); }
  }

  function toggle() {
    if (playing) { pause(); return; }
    playing = true;
    if (live) live.command({ paused: false, speed: Number(byId("speed").value) || null });
    if (moment === last() && (!live || live.state.over)) moment = 0;
    tell();
    run_on();
  }

  // Play from the moment that is shown up to the last one; of a run that goes on the next ones follow.
  function run_on() {
    seconds = run.t[moment];
    let before = performance.now();
    const tick = (now) => {
      if (!playing) return;
      seconds += (now - before) / 1000 * speed();
      before = now;
      const next = lastAt(run.t, seconds);
      if (next > moment) show(next);
      if (moment < last()) requestAnimationFrame(tick);
      else if (!live || live.state.over) halt();
    };
    requestAnimationFrame(tick);
  }

  // Take in what is new; whoever watches the newest moment sees the next one.
  async function follow() {
    for (;;) {
      const before = last(), count = await live.more();
      if (count) {
        complete();
        for (const plot of plots) plot.stored = null;
        if (stepping) show(before + 1);
        else if (playing && moment === before) show(last());
        else draw();
        stepping = false;
      }
      if (live.state.over) over();
      tell();
    }
  }

  // Nothing comes any more.
  function over() {
    if (moment === last()) playing = false;
    newest.hidden = byId("fastest").hidden = true;
    if (!Number(byId("speed").value)) byId("speed").value = "1";
  }

  const again = () => { readTheme(); for (const plot of plots) plot.stored = null; return draw(); };
  const pick = (id) => { byId(id).checked = !byId(id).checked; again(); };
  const keys = {
    " ": toggle, ArrowRight: (many) => step(many), ArrowLeft: (many) => step(-many),
    Home: () => { halt(); show(0); }, End: () => end(),
    f: () => pick("follow"), c: () => pick("confidence"),
    e: () => { const one = byId("ellipse"); one.selectedIndex = (one.selectedIndex + 1) % one.length; again(); },
  };
  // One moment on or back; at the newest one of a walk, the walk makes one more.
  const step = (many) => {
    if (live && many > 0 && moment === last() && !live.state.over) {
      if (playing) { pause(); return; }
      stepping = true;
      live.command({ paused: true, step: true });
      return;
    }
    halt(); show(moment + many);
  };
  const end = () => {
    halt();
    if (live && !live.state.over) { playing = true; live.command({ paused: false }); }
    show(last());
  };
  document.addEventListener("keydown", (event) => {
    const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    const typing = event.target instanceof HTMLSelectElement || (event.key === " " && event.target instanceof HTMLInputElement && event.target.type === "checkbox");
    if (!action || typing || event.ctrlKey || event.altKey || event.metaKey) return;
    event.preventDefault();
    action(event.shiftKey ? 10 : 1);
  });
  for (const button of [play, byId("step"), newest]) {
    button.addEventListener("keyup", (event) => { if (event.key === " ") event.preventDefault(); }); // the key was taken above
  }
  play.addEventListener("click", toggle);
  byId("step").addEventListener("click", () => step(1));
  newest.addEventListener("click", end);
  if (live) byId("speed").addEventListener("change", () => live.command({ speed: Number(byId("speed").value) || null }));
  slider.addEventListener("input", () => { halt(); show(Number(slider.value)); });
  byId("bar").addEventListener("submit", (event) => event.preventDefault());
  for (const id of ["follow", "confidence", "ellipse", "layer"]) byId(id).addEventListener("change", again);
  new ResizeObserver(again).observe(byId("stage"));
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", again);
  const linked = () => {
    const found = /[#&]t=([0-9.]+)/.exec(location.hash);
    return found ? seek(Number(found[1])) : null;
  };
  window.addEventListener("hashchange", linked);
  await (linked() || show(live ? last() : 0));
  if (live) follow(); else root.dataset.moments = String(run.t.length);
  root.dataset.ready = "1";
}

start().catch((error) => {
  byId("still").hidden = false;
  byId("replay").hidden = true;
  root.dataset.failed = String(error);
});
