// The top view: x to the right, y up, all in metres of the map.

const FAR_M = 4.0; // the view polygon ends here where it does not meet the floor

class TopView {
  constructor(run) {
    this.run = run;
    this.canvas = byId("map");
    const [x0, y0, x1, y1] = run.box;
    this.canvas.style.aspectRatio = String(Math.min(Math.max((x1 - x0) / (y1 - y0), 0.9), 1.7));
    this.layers = run.layers.map((layer) => {
      const image = new Image();
      image.src = layer.png;
      return { ...layer, image };
    });
    this.ready = Promise.all(this.layers.map((layer) => layer.image.decode()));
    if (!this.layers.length && run.grid) { this.ground = new Ground(run); this.layers.push({ name: "seen so far" }); }
    this.patch = document.createElement("canvas");
    const choice = byId("layer");
    for (const name of ["nothing", ...this.layers.map((layer) => layer.name)]) choice.add(new Option(name));
    choice.selectedIndex = this.layers.length ? 1 : 0;
    byId("layer-choice").hidden = !this.layers.length;
    this.canvas.addEventListener("pointermove", (event) => this.tell(event));
    this.canvas.addEventListener("pointerleave", () => { byId("map-value").textContent = ""; });
    this.complete();
  }

  // Controls and legend for what the run has.
  complete() {
    this.foot = this.run.body ? this.run.body.foot : [0.1, 0.06];
    byId("ellipse-choice").hidden = !this.run.pose.some((pose) => pose);
    byId("confidence-choice").hidden = !this.run.grid;
    this.legend();
  }

  place(x, y) { return [this.left + (x - this.x0) * this.scale, this.bottom - (y - this.y0) * this.scale]; }

  fit(width, height, i) {
    let [x0, y0, x1, y1] = this.run.box;
    const at = this.run.pose[i] || this.cameraPlace(i);
    if (byId("follow").checked && at) [x0, y0, x1, y1] = [at[0] - 1.5, at[1] - 1.5, at[0] + 1.5, at[1] + 1.5];
    this.scale = Math.min((width - 16) / (x1 - x0), (height - 16) / (y1 - y0));
    this.x0 = x0; this.y0 = y0;
    this.left = (width - (x1 - x0) * this.scale) / 2;
    this.bottom = height - (height - (y1 - y0) * this.scale) / 2;
    this.canvas.dataset.scale = String(this.scale); // pixels of a metre
  }

  cameraPlace(i) {
    for (const camera of this.run.cameras) if (camera.pose[i]) return camera.pose[i];
    return null;
  }

  draw(i) {
    const [g, width, height] = sized(this.canvas);
    this.g = g; this.moment = i;
    if (Math.min(width, height) < 50) return; // not laid out yet
    this.fit(width, height, i);
    g.fillStyle = theme.unseen;
    g.fillRect(0, 0, width, height);
    this.below(i);
    this.grid(i);
    this.levels(i);
    for (const area of this.run.areas) this.area(area);
    for (const ring of this.run.footprints) this.polygon(ring, theme.static, 0.1, 0.6);
    for (const [x, y] of this.run.landmarks) this.mark(x, y, "◆", theme.landmark, 10);
    this.views(i);
    this.path(i);
    this.line(this.run.route[i], theme.target, 1.6, [6, 4]);
    for (const [x, y, yaw] of this.run.steps[i] || []) this.box(x, y, yaw, this.foot, null, theme.target);
    for (const track of this.run.tracks[i] || []) this.track(track);
    this.robot(i);
    for (const [k, [x, y]] of this.run.goals.entries()) {
      this.mark(x, y, "★", theme.target, 20);
      if (this.run.goals.length > 1) this.text(x, y, String(k + 1), 12);
    }
    this.scaleBar(width, height);
  }

  below(i) {
    const layer = this.layers[byId("layer").selectedIndex - 1];
    if (!layer) return;
    const [image, left, bottom, wide, high] = layer.image ? this.whole(layer) : this.soFar(i);
    if (!image) return;
    const [x, y] = this.place(left, bottom + high);
    this.g.imageSmoothingEnabled = false;
    const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
    this.g.globalAlpha = this.run.grid ? (dark ? 0.2 : 0.4) : 0.85;
    this.g.drawImage(image, x, y, wide * this.scale, high * this.scale);
    this.g.globalAlpha = 1;
  }

  whole({ image, origin, cell_m: cell }) { return [image, ...origin, image.naturalWidth * cell, image.naturalHeight * cell]; }

  soFar(i) {
    this.ground.at(i);
    if (this.ground.empty) return [null];
    return [this.ground.picture(rgb(theme.free), rgb(theme.occupied), 255), ...this.ground.place];
  }

  // The grid around the robot at moment i: [its bytes, rows, columns, x, y] or null.
  gridAt(i) {
    const grid = this.run.grid;
    const k = grid ? lastAt(grid.moments, i) : -1;
    return k < 0 ? null : [grid.cells[k], ...grid.places[k].slice(1)];
  }

  grid(i) {
    const place = this.gridAt(i);
    if (!place) return;
    const [bytes, rows, columns, x0, y0] = place, cells = rows * columns;
    this.patch.width = columns; this.patch.height = rows;
    const context = this.patch.getContext("2d"), image = context.createImageData(columns, rows);
    const free = rgb(theme.free), occupied = rgb(theme.occupied), sure = byId("confidence").checked;
    for (let row = 0; row < rows; row++) for (let column = 0; column < columns; column++) {
      const from = row * columns + column, to = 4 * ((rows - 1 - row) * columns + column);
      const level = bytes[from];
      if (level === 255) continue;
      const t = level / 254;
      for (let c = 0; c < 3; c++) image.data[to + c] = free[c] + t * (occupied[c] - free[c]);
      image.data[to + 3] = sure ? 70 + 0.72 * bytes[from + cells] : 255;
    }
    context.putImageData(image, 0, 0);
    const size = this.run.grid.cell_m, [x, y] = this.place(x0, y0 + rows * size);
    this.g.imageSmoothingEnabled = false;
    this.g.drawImage(this.patch, x, y, columns * size * this.scale, rows * size * this.scale);
    this.g.strokeStyle = theme.view; this.g.globalAlpha = 0.45; this.g.lineWidth = 1;
    this.g.strokeRect(x, y, columns * size * this.scale, rows * size * this.scale);
    this.g.globalAlpha = 1;
  }

  // Surfaces on which a foot may stand, by height, and what is beyond their sides.
  levels(i) {
    const highest = (ring) => Math.max(...ring.map((corner) => corner[2]));
    for (const [ring, borders] of [...surfacesAt(this.run, i)].sort(([a], [b]) => highest(a) - highest(b))) {
      this.polygon(ring, `rgb(${levelPaint(this.run, ring[0][2]).map(Math.round)})`, 0.55, 0);
      for (const [k, border] of borders.entries()) {
        this.line([ring[k], ring[(k + 1) % ring.length]], [theme.soft, theme.moving, theme.ink][border], border ? 2 : 1, border ? [] : [2, 3]);
      }
    }
  }

  // Where a camera sees the floor, and where its axis meets it.
  views(i) {
    for (const [k, camera] of this.run.cameras.filter((one) => !one.seldom).entries()) {
      const seen = sight(camera, i);
      if (!seen) continue;
      const up = this.run.heights && this.run.heights[i] ? this.run.heights[i][0] : 0;
      const floor = seen.rays.map((ray) => {
        const reach = FAR_M / Math.hypot(...ray);
        const length = ray[2] < -1e-6 ? Math.min(Math.max((up - seen.at[2]) / ray[2], 0), reach) : reach;
        return [seen.at[0] + ray[0] * length, seen.at[1] + ray[1] * length];
      });
      this.polygon(floor.slice(1), theme.view, k ? 0 : 0.16, k ? 0.6 : 1.2);
      if (k) continue;
      this.line([seen.at, floor[0]], theme.view, 1, [2, 3]);
      this.mark(floor[0][0], floor[0][1], "×", theme.view, 14);
      if (!this.run.pose[i]) this.arrow(seen.at[0], seen.at[1], Math.atan2(seen.rays[0][1], seen.rays[0][0]));
    }
  }

  path(i) {
    const poses = this.run.pose.some((pose) => pose) ? this.run.pose : (this.run.cameras[0] || { pose: [] }).pose;
    for (const piece of pieces(this.run, poses, i, poses.length)) this.line(piece, theme.view, 1.2, [], 0.55);
    for (const piece of pieces(this.run, poses, 0, i + 1)) this.line(piece, theme.belief, 2.2);
  }

  robot(i) {
    for (const [x, y, yaw, lifted] of this.run.feet[i] || []) {
      this.box(x, y, yaw, this.foot, theme.belief, theme.belief, lifted ? 0.15 : 0.6);
    }
    const pose = this.run.pose[i];
    if (!pose) return;
    const [x, y, yaw, ...covariance] = pose;
    this.ellipse(x, y, covariance.slice(0, 3), theme.belief, 0.22, Number(byId("ellipse").value));
    const [u, v] = this.place(x, y);
    this.g.strokeStyle = theme.belief; this.g.lineWidth = 1.6;
    if (this.run.body) { this.g.beginPath(); this.g.arc(u, v, Math.max(this.run.body.radius * this.scale, 5), 0, 7); this.g.stroke(); }
    this.arrow(x, y, yaw);
  }

  track(track) {
    const paint = track.moving >= this.run.moving ? theme.moving : theme.static;
    const [x, y] = track.at, [u, v] = this.place(x, y), g = this.g;
    for (const [, weight, mean, covariance] of track.predicted) {
      this.ellipse(mean[0], mean[1], covariance, paint, 0.05 + 0.15 * weight, 1);
    }
    g.globalAlpha = 0.35; g.fillStyle = paint;
    g.beginPath(); g.arc(u, v, Math.max(track.radius * this.scale, 2), 0, 7); g.fill();
    g.globalAlpha = 1;
    this.ellipse(x, y, track.covariance, paint, 0, 1);
    if (track.moving >= this.run.moving) this.line([[x, y], [x + track.velocity[0], y + track.velocity[1]]], paint, 1.6);
    this.text(x, y, String(track.id), Math.max(track.radius * this.scale, 4) + 2);
  }

  ellipse(x, y, covariance, paint, fill, times) {
    const [long, short, angle] = ellipseOf(covariance), [u, v] = this.place(x, y), g = this.g;
    if (!(long * times < 50)) return;
    g.beginPath();
    g.ellipse(u, v, long * times * this.scale, short * times * this.scale, -angle, 0, 7);
    g.globalAlpha = fill; g.fillStyle = paint; g.fill();
    g.globalAlpha = 0.8; g.strokeStyle = paint; g.lineWidth = 1; g.stroke(); g.globalAlpha = 1;
  }

  arrow(x, y, yaw) {
    const [u, v] = this.place(x, y), g = this.g, long = Math.min(Math.max(0.16 * this.scale, 13), 22);
    g.save(); g.translate(u, v); g.rotate(-yaw); g.fillStyle = theme.belief;
    g.beginPath(); g.moveTo(long, 0); g.lineTo(-0.35 * long, 0.42 * long); g.lineTo(-0.12 * long, 0); g.lineTo(-0.35 * long, -0.42 * long);
    g.fill(); g.restore();
  }

  box(x, y, yaw, [long, wide], fill, edge, alpha = 1) {
    const [u, v] = this.place(x, y), g = this.g, s = this.scale;
    g.save(); g.translate(u, v); g.rotate(-yaw);
    g.beginPath(); g.roundRect(-long * s / 2, -wide * s / 2, long * s, wide * s, 0.35 * wide * s);
    if (fill) { g.globalAlpha = alpha; g.fillStyle = fill; g.fill(); }
    g.globalAlpha = 1; g.strokeStyle = edge; g.lineWidth = 1.2; g.stroke(); g.restore();
  }

  trace(points) {
    let drawing = false;
    this.g.beginPath();
    for (const point of points) {
      if (!point) { drawing = false; continue; }
      const [u, v] = this.place(point[0], point[1]);
      if (drawing) this.g.lineTo(u, v); else this.g.moveTo(u, v);
      drawing = true;
    }
  }

  line(points, paint, width, dash = [], alpha = 1) {
    if (!points || points.length < 2) return;
    this.trace(points);
    this.g.setLineDash(dash); this.g.globalAlpha = alpha; this.g.strokeStyle = paint; this.g.lineWidth = width;
    this.g.stroke(); this.g.setLineDash([]); this.g.globalAlpha = 1;
  }

  polygon(ring, paint, fill, width) {
    this.trace(ring);
    this.g.closePath();
    this.g.globalAlpha = fill; this.g.fillStyle = paint; this.g.fill();
    this.g.globalAlpha = 0.9; this.g.strokeStyle = paint; this.g.lineWidth = width; this.g.stroke(); this.g.globalAlpha = 1;
  }

  // A gap of a panorama as a sector, an obstacle between its edges.
  area({ ring, name }) {
    this.polygon(ring, name ? theme.static : theme.target, name ? 0.3 : 0.12, name ? 2.4 : 0.8);
    if (name) this.text((ring[0][0] + ring[1][0]) / 2, (ring[0][1] + ring[1][1]) / 2, name, 4);
  }

  mark(x, y, sign, paint, size) {
    const [u, v] = this.place(x, y), g = this.g;
    g.font = `${size}px sans-serif`; g.textAlign = "center"; g.textBaseline = "middle"; g.fillStyle = paint; g.fillText(sign, u, v);
  }

  text(x, y, words, above) {
    const [u, v] = this.place(x, y), g = this.g;
    g.font = "11px sans-serif"; g.textAlign = "center"; g.textBaseline = "bottom";
    g.strokeStyle = theme.paper; g.lineWidth = 3; g.strokeText(words, u, v - above); g.fillStyle = theme.ink; g.fillText(words, u, v - above);
  }

  scaleBar(width, height) {
    const metres = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50].find((m) => m * this.scale > 50) || 100, g = this.g;
    const long = metres * this.scale, u = 12, v = height - 12;
    g.strokeStyle = theme.ink; g.lineWidth = 1.5; g.beginPath(); g.moveTo(u, v - 4); g.lineTo(u, v); g.lineTo(u + long, v); g.lineTo(u + long, v - 4); g.stroke();
    g.font = "11px sans-serif"; g.fillStyle = theme.ink; g.textAlign = "left"; g.textBaseline = "bottom"; g.fillText(`${metres} m`, u + 4, v - 3);
    const [x, y] = [width - 44, height - 12];
    g.beginPath(); g.moveTo(x, y - 26); g.lineTo(x, y); g.lineTo(x + 26, y); g.stroke(); g.fillText("x", x + 29, y + 5); g.fillText("y", x - 3, y - 27);
  }

  // Metres below the pointer, and what the grid says about them.
  tell(event) {
    const x = (event.offsetX - this.left) / this.scale + this.x0, y = (this.bottom - event.offsetY) / this.scale + this.y0;
    let words = `x ${x.toFixed(2)}, y ${y.toFixed(2)} m`;
    const place = this.gridAt(this.moment);
    if (place) {
      const [bytes, rows, columns, x0, y0] = place, size = this.run.grid.cell_m;
      const row = Math.floor((y - y0) / size), column = Math.floor((x - x0) / size);
      if (row >= 0 && row < rows && column >= 0 && column < columns) {
        const at = row * columns + column, level = bytes[at];
        words += level === 255 ? ", unknown" : `, occupied ${(level / 2.54).toFixed(0)} %, confidence ${(bytes[at + rows * columns] / 2.55).toFixed(0)} %`;
      }
    }
    byId("map-value").textContent = words;
  }

  legend() {
    const run = this.run, some = (rows) => rows.some((row) => row && (!Array.isArray(row) || row.length));
    const wanted = [
      ["belief", "robot or camera, path so far", true], ["view", "what a camera sees of the floor, path to come", run.cameras.length],
      ["target", "goal, route and next steps", run.goals.length || some(run.route)],
      ["target", "gap", run.areas.length],
      ["viridis", "surface for a foot, from low to high", run.surfaces], ["moving", "it drops beyond this side", run.surfaces],
      ["ink", "something rises beyond this side", run.surfaces],
      ["static", run.areas.length ? "obstacle with its number" : "static obstacle", run.areas.length || some(run.tracks)],
      ["static", "thin: footprint, as known at the end", run.footprints.length],
      ["moving", "moving obstacle with 95 % ellipse and prediction", run.tracks.some((row) => row.some((one) => one.moving >= run.moving))],
      ["landmark", "landmark", run.landmarks.length], ["occupied", run.grid && run.layers.length ? "occupied; faint: by the map of the whole run" : "occupied", run.grid || run.layers.length],
      ["unseen", "unknown", run.grid || run.layers.length],
    ];
    byId("legend").replaceChildren();
    for (const [name, words, there] of wanted) {
      if (!there) continue;
      const item = document.createElement("li"), swatch = document.createElement("i");
      swatch.style.background = name === "viridis" ? `linear-gradient(90deg, ${[0.15, 0.5, 0.9].map((t) => `rgb(${viridis(t).map(Math.round)})`)})` : `var(--${name})`;
      item.append(swatch, words);
      byId("legend").append(item);
    }
  }
}
