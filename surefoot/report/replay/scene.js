// What stands in space at a moment: robot, plan, tracks, what the cameras see, and the points of the depth picture.

const PAINT = {
  robot: [0.36, 0.68, 0.92], head: [0.82, 0.89, 0.95], dark: [0.10, 0.13, 0.16], path: [0.36, 0.68, 0.92], come: [0.42, 0.47, 0.53],
  view: [0.80, 0.86, 0.92], gaze: [1.0, 0.84, 0.35], plan: [0.30, 0.82, 0.62], moving: [1.0, 0.52, 0.28], static: [0.94, 0.72, 0.22],
};
const REACH_M = 2.5; // the view cone ends here where it does not meet the floor
const MOST_LINES = 60; // of a side: a larger map would be all lines
const LIFT_M = 0.03; // drawn height of a lifted foot
const MARK_M = 0.06; // radius of marks on the floor

class Scene {
  constructor(run) { this.run = run; this.foot = [0.1, 0.06]; }

  draw(shapes, i) {
    const run = this.run;
    this.shapes = shapes;
    if (run.body) this.foot = run.body.foot;
    for (const ring of run.footprints) shapes.band([...ring, ring[0]], 0.012, 0.015, PAINT.static);
    this.metres();
    this.levels(i);
    this.path(i);
    this.plan(i);
    for (const track of run.tracks[i] || []) this.track(track);
    this.views(i);
    this.robot(i);
  }

  // Lines of the floor, one a metre.
  metres() {
    const [x0, y0, x1, y1] = this.run.box.map((value, k) => (k < 2 ? Math.floor(value) : Math.ceil(value)));
    if (Math.max(x1 - x0, y1 - y0) > MOST_LINES) return;
    for (let x = x0; x <= x1; x++) this.shapes.line([x, y0, 0.003], [x, y1, 0.003], PAINT.view, 0.13);
    for (let y = y0; y <= y1; y++) this.shapes.line([x0, y, 0.003], [x1, y, 0.003], PAINT.view, 0.13);
  }

  // Surfaces on which a foot may stand, by height, and what is beyond their sides.
  levels(i) {
    const { shapes, run } = this;
    for (const [ring, borders] of surfacesAt(run, i)) {
      const tint = levelPaint(run, ring[0][2]).map((value) => value / 255);
      for (const corners of triangles(ring)) shapes.triangle(...corners.map((k) => ring[k]), tint, 0.5);
      for (const [k, border] of borders.entries()) {
        const ends = [ring[k], ring[(k + 1) % ring.length]].map(([x, y, z]) => [x, y, z + 0.004]);
        shapes.line(...ends, [PAINT.view, PAINT.moving, PAINT.dark][border], border ? 1 : 0.35);
      }
    }
  }

  path(i) {
    const run = this.run, poses = run.pose.some((one) => one) ? run.pose : null;
    if (run.heights) {
      const at = (k) => run.pose[k] && run.heights[k] && [run.pose[k][0], run.pose[k][1], run.heights[k][0] + 0.01];
      for (let k = 1; k < run.pose.length; k++) if (at(k - 1) && at(k)) this.shapes.line(at(k - 1), at(k), k > i ? PAINT.come : PAINT.path);
      return;
    }
    if (poses) {
      for (const piece of pieces(run, poses, i, poses.length)) this.shapes.band(piece, 0.006, 0.012, PAINT.come);
      for (const piece of pieces(run, poses, 0, i + 1)) this.shapes.band(piece, 0.008, 0.02, PAINT.path);
      return;
    }
    for (let k = 0; run.cameras.length && k < i; k++) {
      const [a, b] = [run.cameras[0].pose[k], run.cameras[0].pose[k + 1]];
      if (a && b && !run.begins.includes(k + 1)) this.shapes.line(a.slice(0, 3), b.slice(0, 3), PAINT.path);
    }
  }

  plan(i) {
    const { shapes, run } = this;
    if (run.route[i] && run.route[i].length > 1) shapes.dashes(run.route[i], 0.01, 0.018, PAINT.plan);
    for (const [x, y, yaw] of run.steps[i] || []) {
      const z = groundAt(run, i, x, y);
      shapes.slab(x, y, yaw, this.foot, z + 0.002, z + 0.012, PAINT.plan, 0.75);
    }
    for (const [k, [x, y]] of run.goals.entries()) {
      const z = groundAt(run, run.t.length - 1, x, y);
      shapes.face(round(x, y, z + 0.005, 0.12, 0.12, 0), PAINT.plan, 0.45);
      shapes.bar([x, y, z], [x, y, z + 0.42], 0.014, [1, 0, 0], PAINT.plan);
      for (const [u, v] of [[0.08, 0], [0, 0.08]]) shapes.face([[x - u, y - v, z + 0.36], [x, y, z + 0.28], [x + u, y + v, z + 0.36], [x, y, z + 0.44]], PAINT.plan);
      shapes.label([x, y, z + 0.47], run.goals.length > 1 ? `goal ${k + 1}` : "goal", PAINT.plan);
    }
  }

  track(track) {
    const { shapes, run } = this, moves = track.moving >= run.moving, paint = moves ? PAINT.moving : PAINT.static;
    const [x, y] = track.at, top = Math.max(track.height || 0, 0.02), radius = Math.max(track.radius, 0.02);
    for (const [, weight, mean, covariance] of track.predicted) shapes.ellipse(mean[0], mean[1], 0.014, covariance, paint, 0.04 + 0.14 * weight);
    shapes.pillar(x, y, radius, 0.004, top, paint, moves ? 0.42 : 0.3);
    shapes.ring(x, y, 0.016, [radius, radius, 0], paint, 0.95, 0.012);
    shapes.ring(x, y, top + 0.001, [radius, radius, 0], paint, 0.95, 0.01);
    shapes.ellipse(x, y, top + 0.012, track.covariance, [1, 1, 1], 0.22);
    if (!moves) return;
    const [u, v] = track.velocity, speed = Math.hypot(u, v);
    shapes.band([[x, y], [x + u, y + v]], 0.02, 0.03, paint);
    shapes.label([x, y, top + 0.1], `${track.id}: ${speed.toFixed(2)} m/s`, paint);
  }

  // The view cone of the first camera, and where the wanted gaze meets the floor.
  views(i) {
    const { shapes, run } = this, camera = run.cameras.find((one) => !one.seldom), seen = camera && sight(camera, i);
    if (!seen) return;
    const floor = run.heights && run.heights[i] ? run.heights[i][0] : 0;
    const ends = seen.rays.map((ray) => meets(seen.at, ray, floor));
    for (let n = 1; n < 5; n++) {
      const next = n % 4 + 1;
      shapes.line(seen.at, ends[n], PAINT.view, 0.6);
      shapes.line(ends[n], ends[next], PAINT.view, 0.6);
      shapes.face([seen.at, ends[n], ends[next]], PAINT.view, 0.05);
    }
    shapes.face(ends.slice(1).map(([x, y, z]) => [x, y, Math.max(z, floor + 0.004)]), PAINT.view, 0.08);
    this.gaze(i, seen, floor);
  }

  gaze(i, seen, floor) {
    const { shapes, run } = this, pose = run.pose[i], wanted = run.gaze[i];
    if (!pose || !wanted) return;
    const pan = pose[2] + wanted[0], tilt = wanted[1], flat = Math.cos(tilt);
    const [x, y, z] = meets(seen.at, [Math.cos(pan) * flat, Math.sin(pan) * flat, -Math.sin(tilt)], floor);
    shapes.line(seen.at, [x, y, z], PAINT.gaze, 0.9);
    shapes.ring(x, y, Math.max(z, floor + 0.02), [MARK_M, MARK_M, 0], PAINT.gaze, 0.95, 0.014);
    shapes.face(round(x, y, Math.max(z, floor + 0.02), 0.018, 0.018, 0), PAINT.gaze);
    shapes.label([x, y, z + 0.05], "gaze", PAINT.gaze);
  }

  robot(i) {
    const { shapes, run, foot } = this, pose = run.pose[i], feet = run.feet[i] || [];
    const heights = run.heights && run.heights[i], up = heights ? heights[0] : 0;
    const soles = feet.map(([, , , lifted], k) => (heights ? heights[k + 1] : lifted * LIFT_M));
    for (const [k, [x, y, yaw]] of feet.entries()) shapes.slab(x, y, yaw, foot, soles[k], soles[k] + 0.022, PAINT.robot);
    if (!pose) return;
    const [x, y, yaw, xx, xy, yy] = pose;
    shapes.ellipse(x, y, up + 0.018, [xx, xy, yy], PAINT.robot, 0.3, Number(byId("ellipse").value));
    if (!run.body) { shapes.band([[x, y], [x + 0.2 * Math.cos(yaw), y + 0.2 * Math.sin(yaw)]], up + 0.02, 0.04, PAINT.robot); return; }
    const [deep, wide, tall] = run.body.trunk, [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    const at = (a, b, z) => [x + c * a - s * b, y + s * a + c * b, up + z], ahead = [c, s, 0], hip = 0.46 * tall, neck = 0.82 * tall;
    shapes.slab(x, y, yaw, [0.8 * deep, 0.7 * wide], up + hip, up + neck, PAINT.robot);
    for (const [k, side] of [1, -1].entries()) {
      shapes.bar(at(0, side * 0.44 * wide, 0.97 * neck), at(0.25 * deep, side * 0.47 * wide, 0.95 * hip), 0.22 * wide, ahead, PAINT.robot);
      if (!feet[k]) continue;
      const [u, v] = feet[k];
      shapes.bar(at(0, side * 0.2 * wide, hip), [u, v, soles[k] + 0.02], 0.26 * wide, ahead, PAINT.robot);
    }
    this.head(i, at(0, 0, 0.91 * tall), yaw, tall);
  }

  // A head that looks where its camera does.
  head(i, place, yaw, tall) {
    const camera = this.run.cameras.find((one) => one.pose[i]), half = 0.085 * tall;
    const pose = camera && camera.pose[i], axis = (v) => (pose ? turned(pose.slice(3), v) : null);
    const ahead = axis([0, 0, 1]) || [Math.cos(yaw), Math.sin(yaw), 0], left = unit(cross([0, 0, 1], ahead)), up = cross(ahead, left);
    const sized = (v, by) => v.map((value) => value * half * by);
    this.shapes.box(place, [sized(ahead, 1), sized(left, 1.1), sized(up, 1)], PAINT.head);
    for (const side of [0.45, -0.45]) {
      const eye = place.map((value, k) => value + half * (1.02 * ahead[k] + side * left[k] + 0.15 * up[k]));
      this.shapes.box(eye, [sized(ahead, 0.06), sized(left, 0.22), sized(up, 0.26)], PAINT.dark);
    }
  }
}

// Where a ray meets the floor at a height, or its end at `REACH_M`.
function meets(at, ray, floor) {
  const reach = REACH_M / Math.hypot(...ray), long = ray[2] < -1e-6 ? Math.min(Math.max((floor - at[2]) / ray[2], 0), reach) : reach;
  return at.map((value, k) => value + ray[k] * long);
}

// Points of the depth picture that is shown, in the colours of the camera picture of the same moment: rows of x, y, z, r, g, b, a.
function seenPoints(run, panes) {
  const depth = panes.find((one) => one.steps), placed = depth && spot(run, depth);
  if (!placed) return new Float32Array(0);
  const colour = panes.find((one) => !one.steps && one.image && one.pane.sensor && one.pane.moments[one.shown] === depth.pane.moments[depth.shown]);
  const seen = colour && spot(run, colour), { width, height } = depth.canvas, rows = [];
  const every = Math.max(1, Math.round(Math.sqrt(width * height / 20000)));
  for (let v = 0; v < height; v += every) for (let u = 0; u < width; u += every) {
    const step = depth.steps[v * width + u];
    if (!step) continue;
    const z = step * depth.pane.metres;
    const turnedRay = turned(placed.turn, [z * (placed.left + u * placed.across), z * (placed.top + v * placed.down), z]);
    const point = turnedRay.map((value, k) => value + placed.at[k]);
    rows.push(...point, ...(seen && tintAt(colour, seen, point) || heightTint(point[2])), 1);
  }
  return new Float32Array(rows);
}

function spot(run, view) {
  const camera = run.cameras.find((one) => one.name === view.pane.sensor), pose = camera && camera.pose[view.pane.moments[view.shown]];
  if (!pose) return null;
  const [left, right, top, bottom] = camera.slopes;
  return { at: pose.slice(0, 3), turn: pose.slice(3), left, top, across: (right - left) / (view.canvas.width - 1), down: (bottom - top) / (view.canvas.height - 1) };
}

function tintAt(view, placed, point) {
  const [x, y, z, w] = placed.turn, [a, b, c] = turned([-x, -y, -z, w], point.map((value, k) => value - placed.at[k]));
  if (c < 0.05) return null;
  const u = Math.round((a / c - placed.left) / placed.across), v = Math.round((b / c - placed.top) / placed.down), { width, height, data } = view.image;
  if (u < 0 || v < 0 || u >= width || v >= height) return null;
  const at = 4 * (v * width + u);
  return [data[at] / 255, data[at + 1] / 255, data[at + 2] / 255];
}

function heightTint(z) { return viridis(0.25 + z / 0.8).map((value) => value / 255); }
