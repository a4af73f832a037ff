// The packed data of the page: base64 and gzip to JSON, arrays and pictures.

const root = document.documentElement;
const byId = (id) => document.getElementById(id);

function bytesOf(base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
  return bytes;
}

async function unpacked(base64) {
  const stream = new Blob([bytesOf(base64)]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

async function load() {
  const packed = JSON.parse(byId("packed").textContent);
  byId("packed").remove();
  const run = JSON.parse(new TextDecoder().decode(await unpacked(packed.run)));
  if (run.grid) {
    const bytes = await unpacked(packed.grid);
    run.grid.cells = run.grid.places.map(([offset, rows, columns]) => bytes.subarray(offset, offset + 3 * rows * columns));
  }
  if (run.cloud) run.cloud.bytes = await unpacked(packed.cloud);
  if (run.gaze_map) {
    const bytes = await unpacked(packed.gaze_map), size = run.gaze_map.rows * run.gaze_map.columns;
    run.gaze_map.maps = run.gaze_map.moments.map((_, k) => bytes.subarray(k * size, (k + 1) * size));
  }
  run.panes.forEach((pane, i) => { pane.pictures = packed.pictures[i]; });
  return run;
}

// The last entry of a sorted list of moments that is not after moment i; -1 before the first.
function lastAt(moments, i) {
  let low = 0, high = moments.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (moments[middle] <= i) low = middle + 1; else high = middle;
  }
  return low - 1;
}

// The poses from moment a to moment b, in pieces: none goes on from one session of a merged map to the next.
function pieces(run, poses, a, b) {
  const ends = [a, ...run.begins.filter((k) => k > a && k < b), b];
  return ends.slice(1).map((end, n) => poses.slice(ends[n], end));
}

function colour(name) { return getComputedStyle(root).getPropertyValue(`--${name}`).trim(); }

let theme = {};
function readTheme() {
  for (const name of ["paper", "ground", "ink", "soft", "line", "belief", "target", "static", "moving", "landmark",
    "view", "unseen", "free", "occupied"]) theme[name] = colour(name);
}

function rgb(hex) { return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16)); }

// A canvas with as many pixels as the screen shows; returns its context, scaled to CSS pixels.
function sized(canvas) {
  const scale = window.devicePixelRatio || 1;
  const width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  return [context, width, height];
}

// Viridis by eight colours; t in [0, 1].
const VIRIDIS = [[68, 1, 84], [70, 50, 127], [54, 92, 141], [39, 127, 142], [31, 161, 135], [74, 194, 109], [159, 218, 58], [253, 231, 37]];
function viridis(t) {
  const at = Math.min(Math.max(t, 0), 1) * (VIRIDIS.length - 1);
  const k = Math.min(Math.floor(at), VIRIDIS.length - 2), rest = at - k;
  return VIRIDIS[k].map((low, c) => low + rest * (VIRIDIS[k + 1][c] - low));
}

// Half axes and direction of the 95 % ellipse of a covariance [xx, xy, yy].
const CHI = Math.sqrt(5.991);
function ellipseOf([xx, xy, yy]) {
  const mean = (xx + yy) / 2, root2 = Math.hypot((xx - yy) / 2, xy);
  return [CHI * Math.sqrt(Math.max(mean + root2, 0)), CHI * Math.sqrt(Math.max(mean - root2, 0)), Math.atan2(2 * xy, xx - yy) / 2];
}

// The surfaces of ground with several levels at moment i: [corners, borders] of each; none on one floor.
function surfacesAt(run, i) {
  const k = run.surfaces ? lastAt(run.surfaces.moments, i) : -1;
  return k < 0 ? [] : run.surfaces.of[k];
}

// Height of the ground at a place: of the highest surface there, else of the ground of the start.
function groundAt(run, i, x, y) {
  let top = null;
  for (const [ring] of surfacesAt(run, i)) {
    if (!inside(ring, x, y)) continue;
    const mean = ring.reduce((sum, corner) => sum + corner[2], 0) / ring.length;
    top = top === null ? mean : Math.max(top, mean);
  }
  return top || 0;
}

function inside(ring, x, y) {
  let within = false;
  for (let k = 0, j = ring.length - 1; k < ring.length; j = k++) {
    const [a, b] = [ring[k], ring[j]];
    if ((a[1] > y) !== (b[1] > y) && x < (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]) + a[0]) within = !within;
  }
  return within;
}

// Colour of a surface by its height among those of the run.
function levelPaint(run, height) {
  const { low, high } = run.surfaces;
  return viridis(high - low < 0.02 ? 0.5 : 0.15 + 0.75 * (height - low) / (high - low));
}

// Triangles of a simple ring that is counterclockwise from above, as indices of its corners.
function triangles(ring) {
  const left = ring.map((_, k) => k), found = [];
  const turn = ([a, b], [c, d], [e, f]) => (c - a) * (f - b) - (d - b) * (e - a);
  for (let k = 0, misses = 0; left.length > 3 && misses < left.length;) {
    const [p, q, r] = [0, 1, 2].map((n) => left[(k + n) % left.length]), corner = [ring[p], ring[q], ring[r]];
    const ear = turn(...corner) > 1e-9 && !left.some((n) => n !== p && n !== q && n !== r && turn(corner[0], corner[1], ring[n]) > 0
      && turn(corner[1], corner[2], ring[n]) > 0 && turn(corner[2], corner[0], ring[n]) > 0);
    if (ear) { found.push([p, q, r]); left.splice((k + 1) % left.length, 1); misses = 0; } else { k = (k + 1) % left.length; misses += 1; }
    if (k >= left.length) k = 0;
  }
  if (left.length === 3) found.push(left);
  return found;
}

// A vector turned by a quaternion (x, y, z, w).
function turned([x, y, z, w], [a, b, c]) {
  const u = 2 * (y * c - z * b), v = 2 * (z * a - x * c), s = 2 * (x * b - y * a);
  return [a + w * u + y * s - z * v, b + w * v + z * u - x * s, c + w * s + x * v - y * u];
}

// The pose of a camera at moment i, or null: position, and rays of its axis and of the corners of its picture.
function sight(camera, i) {
  const pose = camera.pose[i];
  if (!pose) return null;
  const [left, right, top, bottom] = camera.slopes;
  const rays = [[0, 0], [left, top], [right, top], [right, bottom], [left, bottom]];
  return { at: pose.slice(0, 3), rays: rays.map(([u, v]) => turned(pose.slice(3), [u, v, 1])) };
}
