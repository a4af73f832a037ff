// The pane in space (WebGL 2): the ground that was seen, a cloud, and the scene of the moment.

const POINTS = `#version 300 es
in vec3 at; in vec4 tint; uniform mat4 view; uniform float size; out vec4 paint;
void main() { gl_Position = view * vec4(at, 1.0); gl_PointSize = clamp(size / gl_Position.w, 1.5, 14.0); paint = tint; }`;
const COLOURED = `#version 300 es
precision mediump float; in vec4 paint; out vec4 colour;
void main() { colour = paint; }`;
const FLOOR = `#version 300 es
in vec3 at; in vec4 tint; uniform mat4 view; out vec2 where;
void main() { gl_Position = view * vec4(at, 1.0); where = tint.xy; }`;
const PICTURED = `#version 300 es
precision mediump float; in vec2 where; uniform sampler2D picture; out vec4 colour;
void main() { colour = texture(picture, where); }`;
const ROW = 7; // floats of a vertex: place, colour, opacity
const FLOOR_FREE = [74, 86, 98], FLOOR_OCCUPIED = [150, 104, 84], BACK = [0.067, 0.086, 0.106];
const FIRST = { behind: 0.55, pitch: 0.62, distance: 2.9, ahead_m: 0.5 }; // where the camera of a live page stands at first

class Space {
  constructor(run, panes) {
    this.run = run; this.panes = panes;
    this.canvas = byId("space");
    this.gl = run.cloud || run.cameras.length || run.grid ? this.canvas.getContext("webgl2", { antialias: true, alpha: false }) : null;
    if (!this.gl) return;
    byId("space-pane").hidden = false;
    this.points = this.program(POINTS, COLOURED); this.floor = this.program(FLOOR, PICTURED);
    this.scene = new Scene(run); this.ground = new Ground(run);
    this.buffers = new Map();
    const rows = run.cloud ? this.pointsOf(run.cloud) : null;
    this.store("cloud", rows || []);
    byId("cloud-choice").hidden = !rows;
    const spread = rows || (run.grows ? null : this.cornersOf(run.surfaces));
    byId("follow-space").checked = !spread;
    if (spread) this.aim(spread); else this.stand();
    this.visible = true;
    new IntersectionObserver(([entry]) => { this.visible = entry.isIntersecting; if (this.visible) this.again(); }).observe(this.canvas);
    for (const id of ["cloud", "follow-space"]) byId(id).addEventListener("change", () => this.again());
    this.controls();
  }

  program(corners, pixels) {
    const gl = this.gl, made = gl.createProgram();
    for (const [kind, text] of [[gl.VERTEX_SHADER, corners], [gl.FRAGMENT_SHADER, pixels]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(made, shader);
    }
    gl.bindAttribLocation(made, 0, "at"); gl.bindAttribLocation(made, 1, "tint");
    gl.linkProgram(made);
    return { made, view: gl.getUniformLocation(made, "view"), size: gl.getUniformLocation(made, "size") };
  }

  // Corners of the last surfaces of ground with several levels, as rows; null on one floor.
  cornersOf(surfaces) {
    return surfaces && surfaces.of[surfaces.of.length - 1].flatMap(([ring]) => ring.flatMap((corner) => [...corner, 0, 0, 0, 0]));
  }

  // Look at the middle of the cloud, or of the surfaces, from where most of it fills the pane.
  aim(rows) {
    const [x0, y0, x1, y1] = this.run.box, span = [[x0, x1], [y0, y1]], every = rows.length > 5000 * ROW ? 11 : 1;
    for (let c = 0; c < 2; c++) {
      const values = [];
      for (let k = c; k < rows.length; k += every * ROW) values.push(rows[k]);
      values.sort((a, b) => a - b);
      span[c] = [0.02, 0.98].map((share) => values[Math.floor(share * (values.length - 1))]);
    }
    this.centre = [(span[0][0] + span[0][1]) / 2, (span[1][0] + span[1][1]) / 2, 0.1];
    this.distance = 0.68 * Math.hypot(span[0][1] - span[0][0], span[1][1] - span[1][0]) + 0.4;
    this.yaw = -1.9; this.pitch = 0.85;
  }

  // Stand behind the robot, or the camera, and look over it.
  stand() {
    const i = this.run.t.length - 1, pose = this.run.pose[i], [x, y] = this.placeAt(i) || [0, 0];
    const heading = pose ? pose[2] : Math.PI / 2;
    this.followed = this.placeAt(i);
    this.height = this.run.heights && this.run.heights[i] ? this.run.heights[i][0] : 0;
    this.centre = [x + FIRST.ahead_m * Math.cos(heading), y + FIRST.ahead_m * Math.sin(heading), this.height + 0.1];
    this.yaw = heading + Math.PI + FIRST.behind; this.pitch = FIRST.pitch; this.distance = FIRST.distance;
  }

  placeAt(i) {
    if (this.run.pose[i]) return this.run.pose[i];
    const camera = this.run.cameras.find((one) => one.pose[i]);
    return camera ? camera.pose[i] : null;
  }

  pointsOf({ count, low, step, bytes }) {
    const at = new Uint16Array(bytes.buffer, 0, 3 * count), tint = bytes.subarray(6 * count), rows = new Float32Array(ROW * count).fill(1);
    for (let k = 0; k < count; k++) for (let c = 0; c < 3; c++) {
      rows[ROW * k + c] = low[c] + at[3 * k + c] * step;
      rows[ROW * k + 3 + c] = tint[3 * k + c] / 255;
    }
    return rows;
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

  follow(i) {
    const now = this.placeAt(i), before = this.followed;
    this.followed = now || before;
    if (!now || !before || !byId("follow-space").checked) return;
    const rise = this.run.heights && this.run.heights[i] ? this.run.heights[i][0] - (this.height || 0) : 0;
    for (const [c, way] of [now[0] - before[0], now[1] - before[1], rise].entries()) this.centre[c] += way;
    this.height = (this.height || 0) + rise;
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
    if (!this.gl) return;
    this.moment = i;
    this.follow(i);
    if (!this.visible) return;
    const gl = this.gl, scale = Math.min(window.devicePixelRatio || 1, 2), canvas = this.canvas;
    const [width, height] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
    if (!width) return;
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    const view = this.matrix(width, height), shapes = new Shapes();
    this.scene.draw(shapes, i);
    this.refresh(i);
    gl.viewport(0, 0, width, height); gl.enable(gl.DEPTH_TEST); gl.depthMask(true);
    gl.clearColor(...BACK, 1); gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.BLEND); gl.blendFuncSeparate(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA, gl.ONE, gl.ONE);
    gl.useProgram(this.floor.made); gl.uniformMatrix4fv(this.floor.view, false, view);
    if (!this.ground.empty) this.rows("floor", gl.TRIANGLES);
    gl.useProgram(this.points.made); gl.uniformMatrix4fv(this.points.view, false, view);
    gl.uniform1f(this.points.size, 0.03 * height);
    const clouded = this.run.cloud && byId("cloud").checked;
    if (clouded) this.rows("cloud", gl.POINTS);
    else { this.rows("blocks", gl.TRIANGLES); this.rows("seen", gl.POINTS); }
    this.store("solid", shapes.solid); this.rows("solid", gl.TRIANGLES);
    this.store("lines", shapes.lines); this.rows("lines", gl.LINES);
    gl.depthMask(false);
    this.store("clear", shapes.clear); this.rows("clear", gl.TRIANGLES);
    this.words(shapes.labels, view);
    canvas.dataset.moment = String(i);
  }

  // Ground and points of the moment, where they are new.
  refresh(i) {
    if (this.ground.at(i)) {
      const [x, y, wide, high] = this.ground.empty ? [0, 0, 0, 0] : this.ground.place, shapes = new Shapes();
      const corner = (a, b) => [x + a * wide, y + b * high, 0, a, 1 - b, 0, 0];
      this.store("floor", [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]].flatMap(([a, b]) => corner(a, b)));
      if (!this.ground.empty) { this.ground.blocks(shapes, blockPaint); this.pave(); }
      this.store("blocks", shapes.solid);
    }
    const depth = this.panes.find((one) => one.steps), shown = depth ? depth.shown : -1;
    if (shown !== this.pictured) {
      this.pictured = shown;
      this.store("seen", seenPoints(this.run, this.panes));
    }
  }

  pave() {
    const gl = this.gl, nearest = gl.NEAREST, edge = gl.CLAMP_TO_EDGE;
    this.texture = this.texture || gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, this.ground.picture(FLOOR_FREE, FLOOR_OCCUPIED, 110));
    for (const [name, value] of [[gl.TEXTURE_MIN_FILTER, nearest], [gl.TEXTURE_MAG_FILTER, nearest], [gl.TEXTURE_WRAP_S, edge], [gl.TEXTURE_WRAP_T, edge]]) gl.texParameteri(gl.TEXTURE_2D, name, value);
  }

  store(name, rows) {
    const gl = this.gl, buffer = this.buffers.get(name) || { data: gl.createBuffer() };
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer.data);
    gl.bufferData(gl.ARRAY_BUFFER, rows instanceof Float32Array ? rows : new Float32Array(rows), gl.DYNAMIC_DRAW);
    buffer.count = rows.length / ROW;
    this.buffers.set(name, buffer);
  }

  rows(name, kind) {
    const gl = this.gl, buffer = this.buffers.get(name);
    if (!buffer || !buffer.count) return;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer.data);
    for (const [place, size] of [[0, 3], [1, 4]]) { gl.enableVertexAttribArray(place); gl.vertexAttribPointer(place, size, gl.FLOAT, false, 4 * ROW, 12 * place); }
    gl.drawArrays(kind, 0, buffer.count);
  }

  words(labels, view) {
    const [g, width, height] = sized(byId("space-words"));
    g.clearRect(0, 0, width, height);
    g.font = "600 12px ui-sans-serif, system-ui, sans-serif"; g.textAlign = "center"; g.textBaseline = "bottom"; g.lineJoin = "round";
    for (const { at, words, paint } of labels) {
      const [x, y, , w] = [0, 1, 2, 3].map((k) => view[k] * at[0] + view[4 + k] * at[1] + view[8 + k] * at[2] + view[12 + k]);
      if (w < 0.05) continue;
      const [u, v] = [(1 + x / w) * width / 2, (1 - y / w) * height / 2];
      g.strokeStyle = "rgba(10, 14, 18, 0.85)"; g.lineWidth = 4; g.strokeText(words, u, v);
      g.fillStyle = `rgb(${paint.map((value) => Math.round(255 * value))})`; g.fillText(words, u, v);
    }
  }
}

// Blocks of the ground: brown-grey where low, paler where high.
function blockPaint(height) {
  const t = Math.min(height / 0.6, 1);
  return [0.52 + 0.30 * t, 0.46 + 0.34 * t, 0.42 + 0.38 * t];
}
