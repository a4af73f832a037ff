// Triangles, lines and labels in metres, for one drawing in space.

const SIDES = 28; // of a round thing
const LIGHT = [0.36, -0.48, 0.8];

class Shapes {
  constructor() { this.solid = []; this.clear = []; this.lines = []; this.labels = []; }

  line(a, b, paint, alpha = 1) { this.lines.push(...a, ...paint, alpha, ...b, ...paint, alpha); }

  triangle(a, b, c, paint, alpha = 1) {
    const to = alpha < 1 ? this.clear : this.solid;
    for (const p of [a, b, c]) to.push(p[0], p[1], p[2], paint[0], paint[1], paint[2], alpha);
  }

  // A flat convex face; lit faces are darker where they look away from the light.
  face(ring, paint, alpha = 1, lit = false) {
    const tint = lit ? shaded(ring, paint) : paint;
    for (let k = 2; k < ring.length; k++) this.triangle(ring[0], ring[k - 1], ring[k], tint, alpha);
  }

  // A box from its centre and the three half edges.
  box(centre, [a, b, c], paint, alpha = 1) {
    const at = (i, j, k) => centre.map((value, n) => value + i * a[n] + j * b[n] + k * c[n]);
    for (const s of [-1, 1]) {
      this.face([at(s, -s, -1), at(s, s, -1), at(s, s, 1), at(s, -s, 1)], paint, alpha, true);
      this.face([at(s, s, -1), at(-s, s, -1), at(-s, s, 1), at(s, s, 1)], paint, alpha, true);
      this.face([at(-1, -s, s), at(1, -s, s), at(1, s, s), at(-1, s, s)], paint, alpha, true);
    }
  }

  // A box that stands on the floor, turned by yaw.
  slab(x, y, yaw, [long, wide], bottom, top, paint, alpha = 1) {
    const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    this.box([x, y, (bottom + top) / 2], [[c * long / 2, s * long / 2, 0], [-s * wide / 2, c * wide / 2, 0], [0, 0, (top - bottom) / 2]], paint, alpha);
  }

  // A bar between two points, square, with a side of the given width.
  bar(from, to, width, side, paint) {
    const along = to.map((value, k) => (value - from[k]) / 2), wide = unit(cross(along, side)), deep = unit(cross(wide, along));
    this.box(from.map((value, k) => value + along[k]), [along, wide.map((v) => v * width / 2), deep.map((v) => v * width / 2)], paint);
  }

  // A flat band on the floor.
  band(points, height, width, paint, alpha = 1) {
    for (let k = 1; k < points.length; k++) {
      const [p, q] = [points[k - 1], points[k]];
      if (!p || !q) continue;
      const long = Math.hypot(q[0] - p[0], q[1] - p[1]);
      if (!(long > 1e-4)) continue;
      const [u, v] = [(q[1] - p[1]) / long * width / 2, (p[0] - q[0]) / long * width / 2];
      this.face([[p[0] + u, p[1] + v, height], [q[0] + u, q[1] + v, height], [q[0] - u, q[1] - v, height], [p[0] - u, p[1] - v, height]], paint, alpha);
    }
  }

  dashes(points, height, width, paint, long = 0.06) {
    let left = long, on = true;
    for (let k = 1; k < points.length; k++) {
      let [x, y] = points[k - 1];
      const [u, v] = points[k];
      for (let rest = Math.hypot(u - x, v - y); rest > 1e-6;) {
        const part = Math.min(rest, left), a = x + (u - x) * part / rest, b = y + (v - y) * part / rest;
        if (on) this.band([[x, y], [a, b]], height, width, paint);
        [x, y] = [a, b]; rest -= part; left -= part;
        if (left < 1e-9) { left = long; on = !on; }
      }
    }
  }

  ring(x, y, height, [long, short, direction], paint, alpha, width) {
    const [inner, outer] = [round(x, y, height, long - width / 2, short - width / 2, direction), round(x, y, height, long + width / 2, short + width / 2, direction)];
    for (let k = 0; k < SIDES; k++) this.face([inner[k], outer[k], outer[(k + 1) % SIDES], inner[(k + 1) % SIDES]], paint, alpha);
  }

  // The ellipse of a covariance: a pale disc with a rim, or nothing where it is not finite.
  ellipse(x, y, height, covariance, paint, alpha, times = 1) {
    if (covariance.some((value) => value === null)) return;
    const [long, short, direction] = ellipseOf(covariance), half = [long * times, short * times, direction];
    if (!(half[0] < 50)) return;
    this.face(round(x, y, height, ...half), paint, alpha);
    this.ring(x, y, height + 0.001, half, paint, Math.min(3 * alpha, 0.95), 0.008);
  }

  // A standing round pillar.
  pillar(x, y, radius, bottom, top, paint, alpha) {
    const [low, high] = [round(x, y, bottom, radius, radius, 0), round(x, y, top, radius, radius, 0)];
    for (let k = 0; k < SIDES; k++) {
      const n = (k + 1) % SIDES;
      this.face([low[k], low[n], high[n], high[k]], paint, alpha, true);
    }
    this.face(high, paint, alpha, true);
  }

  label(at, words, paint) { this.labels.push({ at, words, paint }); }
}

function round(x, y, height, long, short, direction) {
  const [c, s] = [Math.cos(direction), Math.sin(direction)];
  return Array.from({ length: SIDES }, (_, k) => {
    const turn = 2 * Math.PI * k / SIDES, a = long * Math.cos(turn), b = short * Math.sin(turn);
    return [x + c * a - s * b, y + s * a + c * b, height];
  });
}

function cross(a, b) { return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]; }
function unit(a) { const long = Math.hypot(...a) || 1; return a.map((value) => value / long); }

function shaded(ring, paint) {
  const [p, q, r] = ring, normal = unit(cross(q.map((v, k) => v - p[k]), r.map((v, k) => v - p[k])));
  const light = 0.62 + 0.38 * (normal[0] * LIGHT[0] + normal[1] * LIGHT[1] + normal[2] * LIGHT[2]);
  return paint.map((value) => value * Math.max(light, 0.3));
}
