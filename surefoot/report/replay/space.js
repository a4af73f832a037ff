// The cloud, the robot and what its cameras see, in space (WebGL 2).

const POINTS = `#version 300 es
in vec3 at; in vec3 tint; uniform mat4 view; uniform float size; out vec3 paint;
void main() { gl_Position = view * vec4(at, 1.0); gl_PointSize = clamp(size / gl_Position.w, 1.5, 14.0); paint = tint; }`;
const PAINT = `#version 300 es
precision mediump float; in vec3 paint; out vec4 colour;
void main() { colour = vec4(paint, 1.0); }`;

class Space {
  constructor(run) {
    this.run = run;
    this.canvas = byId("space");
    this.gl = run.cloud || run.cameras.length ? this.canvas.getContext("webgl2", { antialias: true }) : null;
    if (!this.gl) return;
    byId("space-pane").hidden = false;
    const gl = this.gl;
    this.program = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, POINTS], [gl.FRAGMENT_SHADER, PAINT]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(this.program, shader);
    }
    gl.bindAttribLocation(this.program, 0, "at"); gl.bindAttribLocation(this.program, 1, "tint");
    gl.linkProgram(this.program);
    this.view = gl.getUniformLocation(this.program, "view"); this.size = gl.getUniformLocation(this.program, "size");
    this.yaw = -1.9; this.pitch = 0.85;
    const rows = run.cloud ? this.pointsOf(run.cloud) : null;
    this.cloud = rows ? this.fixed(rows) : null;
    this.aim(rows);
    this.lines = gl.createBuffer(); this.faces = gl.createBuffer();
    this.visible = true;
    new IntersectionObserver(([entry]) => { this.visible = entry.isIntersecting; if (this.visible) this.again(); }).observe(this.canvas);
    this.controls();
  }

  // Look at the middle of the cloud, from where most of it fills the pane.
  aim(rows) {
    const [x0, y0, x1, y1] = this.run.box, span = [[x0, x1], [y0, y1]];
    for (let c = 0; rows && c < 2; c++) {
      const values = [];
      for (let k = c; k < rows.length; k += 66) values.push(rows[k]);
      values.sort((a, b) => a - b);
      span[c] = [0.02, 0.98].map((share) => values[Math.floor(share * (values.length - 1))]);
    }
    this.centre = [(span[0][0] + span[0][1]) / 2, (span[1][0] + span[1][1]) / 2, 0.1];
    this.distance = 0.68 * Math.hypot(span[0][1] - span[0][0], span[1][1] - span[1][0]) + 0.4;
  }

  pointsOf({ count, low, step, bytes }) {
    const at = new Uint16Array(bytes.buffer, 0, 3 * count), tint = bytes.subarray(6 * count), rows = new Float32Array(6 * count);
    for (let k = 0; k < count; k++) for (let c = 0; c < 3; c++) {
      rows[6 * k + c] = low[c] + at[3 * k + c] * step;
      rows[6 * k + 3 + c] = tint[3 * k + c] / 255;
    }
    return rows;
  }

  fixed(rows) {
    const buffer = this.gl.createBuffer();
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, buffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, rows, this.gl.STATIC_DRAW);
    return { buffer, count: rows.length / 6 };
  }

  controls() {
    const held = new Map(), canvas = this.canvas;
    let apart = 0;
    canvas.style.touchAction = "pan-y";
    canvas.addEventListener("pointerdown", (event) => { held.set(event.pointerId, [event.offsetX, event.offsetY]); canvas.setPointerCapture(event.pointerId); });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => { held.delete(event.pointerId); apart = 0; });
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("pointermove", (event) => {
      const before = held.get(event.pointerId);
      if (!before) return;
      const du = event.offsetX - before[0], dv = event.offsetY - before[1];
      held.set(event.pointerId, [event.offsetX, event.offsetY]);
      if (held.size === 2) {
        const [[a, b], [c, d]] = held.values(), now = Math.hypot(a - c, b - d);
        if (apart) this.distance *= apart / now;
        apart = now;
      }
      if (held.size === 2 || event.buttons & 2) this.move(-du, dv); else this.turn(du, dv);
      this.again();
    });
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault(); this.distance *= Math.exp(event.deltaY / 500); this.again();
    }, { passive: false });
    canvas.addEventListener("keydown", (event) => {
      const turn = { a: [-20, 0], d: [20, 0], w: [0, 12], s: [0, -12] }[event.key.toLowerCase()];
      if (turn) this.turn(...turn);
      else if (event.key === "+") this.distance /= 1.15;
      else if (event.key === "-") this.distance *= 1.15;
      else return;
      event.preventDefault(); this.again();
    });
  }

  turn(du, dv) { this.yaw -= du / 150; this.pitch = Math.min(Math.max(this.pitch + dv / 150, -0.2), 1.55); }

  move(du, dv) {
    const step = this.distance / 500, [c, s] = [Math.cos(this.yaw), Math.sin(this.yaw)];
    this.centre[0] += step * (-s * du - c * dv); this.centre[1] += step * (c * du - s * dv);
  }

  matrix(width, height) {
    const [cy, sy, cp, sp] = [Math.cos(this.yaw), Math.sin(this.yaw), Math.cos(this.pitch), Math.sin(this.pitch)];
    const back = [cy * cp, sy * cp, sp], right = [-sy, cy, 0], up = [-cy * sp, -sy * sp, cp];
    const eye = this.centre.map((value, c) => value + this.distance * back[c]), dot = (a) => a[0] * eye[0] + a[1] * eye[1] + a[2] * eye[2];
    const f = 1.7, w = f * Math.min(height / width, 1), h = f * Math.min(width / height, 1), [near, far] = [0.05, 20 * this.distance];
    const p = (near + far) / (near - far), q = 2 * near * far / (near - far), z = back;
    return new Float32Array([0, 1, 2].flatMap((c) => [w * right[c], h * up[c], p * z[c], -z[c]])
      .concat([-w * dot(right), -h * dot(up), -p * dot(z) + q, dot(z)]));
  }

  again() {
    if (this.asked || this.moment === undefined) return;
    this.asked = true;
    requestAnimationFrame(() => { this.asked = false; this.draw(this.moment); });
  }

  draw(i) {
    this.moment = i;
    if (!this.gl || !this.visible) return;
    const gl = this.gl, scale = Math.min(window.devicePixelRatio || 1, 2), canvas = this.canvas;
    const [width, height] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
    if (!width) return;
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    gl.viewport(0, 0, width, height); gl.enable(gl.DEPTH_TEST);
    gl.clearColor(0.067, 0.086, 0.106, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.useProgram(this.program);
    gl.uniformMatrix4fv(this.view, false, this.matrix(width, height));
    gl.uniform1f(this.size, 0.03 * height);
    if (this.cloud) this.rows(this.cloud.buffer, this.cloud.count, gl.POINTS);
    const lines = [], faces = [];
    this.things(i, lines, faces);
    this.moving(this.faces, faces, gl.TRIANGLES);
    this.moving(this.lines, lines, gl.LINES);
    canvas.dataset.moment = String(i);
  }

  rows(buffer, count, kind) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    for (const place of [0, 1]) { gl.enableVertexAttribArray(place); gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 24, 12 * place); }
    gl.drawArrays(kind, 0, count);
  }

  moving(buffer, rows, kind) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, buffer);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, new Float32Array(rows), this.gl.DYNAMIC_DRAW);
    this.rows(buffer, rows.length / 6, kind);
  }

  things(i, lines, faces) {
    const run = this.run, blue = [0.39, 0.7, 0.9], grey = [0.75, 0.8, 0.85], green = [0.3, 0.79, 0.63], orange = [1, 0.6, 0.34], yellow = [0.94, 0.71, 0.16];
    const line = (a, b, paint) => lines.push(...a, ...paint, ...b, ...paint);
    const path = (points, height, paint) => points.forEach((p, k) => {
      const q = points[k + 1];
      if (p && q) line([p[0], p[1], height], [q[0], q[1], height], paint);
    });
    const slab = (x, y, yaw, [long, wide], bottom, top, paint) => {
      const [c, s] = [Math.cos(yaw), Math.sin(yaw)];
      const corner = (a, b, z) => [x + c * a * long / 2 - s * b * wide / 2, y + s * a * long / 2 + c * b * wide / 2, z];
      const ring = (z) => [[1, 1], [-1, 1], [-1, -1], [1, -1]].map(([a, b]) => corner(a, b, z));
      const [low, high] = [ring(bottom), ring(top)];
      const quad = (a, b, e, d, shade) => { const tint = paint.map((v) => v * shade); for (const p of [a, b, e, a, e, d]) faces.push(...p, ...tint); };
      quad(...high, 1);
      for (let k = 0; k < 4; k++) quad(low[k], low[(k + 1) % 4], high[(k + 1) % 4], high[k], 0.6 + 0.1 * k);
    };
    const pose = run.pose[i], foot = run.body ? run.body.foot : [0.1, 0.06];
    if (run.pose.some((one) => one)) { path(run.pose.slice(0, i + 1), 0.02, blue); path(run.pose.slice(i), 0.02, [0.4, 0.45, 0.5]); }
    else if (run.cameras.length) for (let k = 0; k < i; k++) {
      const [a, b] = [run.cameras[0].pose[k], run.cameras[0].pose[k + 1]];
      if (a && b) line(a.slice(0, 3), b.slice(0, 3), blue);
    }
    if (run.route[i]) path(run.route[i], 0.02, green);
    for (const [x, y, yaw] of run.steps[i] || []) slab(x, y, yaw, foot, 0, 0.01, green);
    for (const [x, y, yaw, lifted] of run.feet[i] || []) slab(x, y, yaw, foot, lifted ? 0.03 : 0, lifted ? 0.06 : 0.03, blue);
    if (pose && run.body) slab(pose[0], pose[1], pose[2], run.body.trunk, 0.45 * run.body.trunk[2], run.body.trunk[2], blue);
    for (const track of run.tracks[i] || []) {
      const paint = track.moving >= run.moving ? orange : yellow, [x, y] = track.at;
      for (let k = 0; k < 24; k++) {
        const [a, b] = [k, k + 1].map((n) => [x + track.radius * Math.cos(n * Math.PI / 12), y + track.radius * Math.sin(n * Math.PI / 12)]);
        line([...a, 0.02], [...b, 0.02], paint); line([...a, track.height], [...b, track.height], paint);
        if (k % 6 === 0) line([...a, 0.02], [...a, track.height], paint);
      }
    }
    for (const [x, y] of run.goals) line([x, y, 0], [x, y, 0.6], green);
    for (const camera of run.cameras) {
      const seen = sight(camera, i);
      if (!seen) continue;
      const ends = seen.rays.map((ray) => seen.at.map((value, c) => value + 0.6 * ray[c]));
      for (let k = 1; k < 5; k++) { line(seen.at, ends[k], grey); line(ends[k], ends[k % 4 + 1], grey); }
    }
  }
}
