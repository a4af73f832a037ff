// A run that still goes on: its moments come from the program that serves this page.

const RECONNECT_MS = 1000;
const OFTEN = 0.5; // a camera with fewer pictures than this share of the moments would make its view flicker

class Live {
  constructor(run) { this.run = run; this.state = { walks: false, paused: false, speed: null, over: false }; this.lost = false; }

  // New moments and the state of the run; the program answers when there is something new.
  async more() {
    try {
      const answer = await fetch(`moments?from=${this.run.t.length}`, { cache: "no-store" });
      if (!answer.ok) throw new Error(answer.statusText);
      const { state, moments } = await answer.json();
      if (this.state.run && this.state.run !== state.run) location.reload(); // another run is served here now
      this.state = state; this.lost = false;
      byId("name").textContent = document.title = state.name;
      for (const one of moments) await append(this.run, one);
      return moments.length;
    } catch (error) {
      if (error instanceof TypeError || error.message) this.lost = true;
      await new Promise((done) => setTimeout(done, RECONNECT_MS));
      return 0;
    }
  }

  command(values) {
    if (!this.state.walks) return;
    Object.assign(this.state, values);
    fetch("walk", { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(values) }).catch(() => { this.lost = true; });
  }

  get words() {
    const { error, over, paused, walks, report } = this.state;
    if (error) return error;
    if (this.lost) return over ? "The run is over, and the program that showed it has ended." : "No connection to the program that shows the run.";
    if (over) return `The run is over; its report: ${report}`;
    return paused && walks ? "The walk is paused." : "The run goes on.";
  }
}

function emptyRun() {
  const lists = ["t", "pose", "head", "feet", "steps", "route", "gaze", "why", "tracks", "cameras", "panes", "values", "series", "goals", "landmarks", "footprints", "areas", "layers", "begins"]; // surfaces and heights: of several levels alone
  return { ...Object.fromEntries(lists.map((name) => [name, []])), grid: null, cloud: null, gaze_map: null, grows: true, heights: null, surfaces: null, body: null, box: null, moving: 0.5, by_number: null };
}

function put(list, i, value) {
  while (list.length < i) list.push(null);
  list[i] = value;
}

// Add a moment to the columns of the run.
async function append(run, one) {
  const i = run.t.length;
  run.moving = one.moving;
  for (const name of ["t", "pose", "head", "feet", "steps", "route", "gaze", "why", "tracks"]) run[name].push(one[name][0]);
  const named = (list, name, made) => list.find((each) => each.name === name) || (list.push(made), made);
  for (const { name, slopes, pose } of one.cameras) {
    const camera = named(run.cameras, name, { name, slopes, pose: [], count: 0 });
    put(camera.pose, i, pose[0]); camera.count += 1;
  }
  for (const camera of run.cameras) {
    if (camera.pose.length <= i) put(camera.pose, i, null);
    camera.seldom = camera.count < OFTEN * run.t.length;
  }
  for (const [name, words] of one.values) {
    let row = run.values.find(([other]) => other === name);
    if (!row) run.values.push(row = [name, []]);
    put(row[1], i, words[0]);
  }
  for (const series of one.series) {
    const plot = named(run.series, series.name, { ...series, lines: [] });
    for (const { name, values } of series.lines) put(named(plot.lines, name, { name, values: [] }).values, i, values[0]);
  }
  for (const plot of run.series) for (const { values } of plot.lines) if (values.length <= i) put(values, i, null);
  for (const { picture, ...pane } of one.panes) {
    const strip = named(run.panes, pane.name, { ...pane, moments: [], pictures: [] });
    strip.moments.push(i); strip.pictures.push(picture); strip.far_step = Math.max(strip.far_step, pane.far_step);
  }
  if (one.grid) {
    const { data, places, ...grid } = one.grid;
    run.grid = run.grid || { ...grid, moments: [], places: [], cells: [] };
    run.grid.moments.push(i); run.grid.places.push(places[0]); run.grid.cells.push(await unpacked(data));
  }
  if (one.gaze_map) {
    const { data, ...map } = one.gaze_map;
    run.gaze_map = run.gaze_map || { ...map, moments: [], maps: [] };
    run.gaze_map.moments.push(i); run.gaze_map.maps.push(await unpacked(data));
  }
  if (one.heights) put(run.heights = run.heights || [], i, one.heights[0]);
  if (one.surfaces) {
    const { of, low, high } = one.surfaces, all = run.surfaces = run.surfaces || { moments: [], of: [], low, high };
    all.moments.push(i); all.of.push(of[0]);
    all.low = Math.min(all.low, low); all.high = Math.max(all.high, high);
  }
  for (const goal of one.goals) if (!run.goals.some((other) => Math.hypot(other[0] - goal[0], other[1] - goal[1]) < 0.01)) run.goals.push(goal);
  run.body = one.body || run.body;
  widen(run, one);
}

// left, bottom, right, top of everything so far.
function widen(run, one) {
  const places = [...run.goals];
  for (const camera of one.cameras) if (camera.pose[0]) places.push(camera.pose[0]);
  if (one.pose[0]) places.push(one.pose[0]);
  for (const [ring] of one.surfaces ? one.surfaces.of[0] : []) places.push(...ring);
  if (one.grid) {
    const [, rows, columns, x, y] = one.grid.places[0], cell = one.grid.cell_m;
    places.push([x, y], [x + columns * cell, y + rows * cell]);
  }
  const box = run.reach || [Infinity, Infinity, -Infinity, -Infinity];
  for (const [x, y] of places) {
    if (x === null || y === null) continue;
    box[0] = Math.min(box[0], x - 0.2); box[1] = Math.min(box[1], y - 0.2);
    box[2] = Math.max(box[2], x + 0.2); box[3] = Math.max(box[3], y + 0.2);
  }
  run.reach = box;
  run.box = Number.isFinite(box[0]) ? box : [-1, -1, 1, 1];
}
