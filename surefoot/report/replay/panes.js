// Pictures of the moment: camera, depth in metres, gaze map; and its figures in words.

class PicturePane {
  constructor(pane) {
    this.pane = pane;
    this.shown = null; // number of the picture; -1 before the first
    this.section = document.createElement("section");
    this.section.classList.toggle("wide", Boolean(pane.wide));
    const title = document.createElement("h2");
    title.textContent = pane.name;
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.output = document.createElement("output");
    this.section.append(title, this.canvas, this.output);
    this.section.style.order = pane.wide ? 2 : pane.metres ? 1 : 0; // cameras first
    byId("pictures").append(this.section);
    this.canvas.addEventListener("pointermove", (event) => this.tell(event));
    this.canvas.addEventListener("pointerleave", () => { this.output.textContent = this.caption; });
  }

  async draw(i, clock) {
    const k = lastAt(this.pane.moments, i);
    if (k === this.shown) return;
    this.shown = k;
    if (k < 0) { this.clear(); return; }
    const picture = new Blob([bytesOf(this.pane.pictures[k])], { type: this.pane.mime });
    const bitmap = await createImageBitmap(picture, { colorSpaceConversion: "none" });
    if (k !== this.shown) return; // another moment was asked for meanwhile
    this.canvas.width = bitmap.width;
    this.canvas.height = bitmap.height;
    const context = this.canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(bitmap, 0, 0);
    if (this.pane.metres) this.paint(context);
    else this.image = context.getImageData(0, 0, bitmap.width, bitmap.height);
    this.canvas.dataset.moment = String(this.pane.moments[k]);
    this.caption = (this.pane.labels ? this.pane.labels[k] : clock(this.pane.moments[k])) + (this.pane.metres ? ", near is bright" : "");
    this.output.textContent = this.caption;
    this.canvas.setAttribute("aria-label", `${this.pane.name}, ${this.caption}`);
  }

  clear() {
    this.canvas.getContext("2d", { willReadFrequently: true }).clearRect(0, 0, this.canvas.width, this.canvas.height);
    this.steps = this.image = null;
    this.canvas.dataset.moment = "";
    this.caption = this.output.textContent = "none yet";
    this.canvas.setAttribute("aria-label", `${this.pane.name}, none yet`);
  }

  // Colours for a depth picture in steps; near is bright, 0 is no depth.
  paint(context) {
    const { width, height } = this.canvas, image = context.getImageData(0, 0, width, height);
    this.steps = new Uint8Array(width * height);
    const table = Array.from({ length: 256 }, (_, step) => (step ? viridis(1 - step / this.pane.far_step) : [0, 0, 0]));
    for (let k = 0; k < this.steps.length; k++) {
      const step = image.data[4 * k];
      this.steps[k] = step;
      for (let c = 0; c < 3; c++) image.data[4 * k + c] = table[step][c];
    }
    context.putImageData(image, 0, 0);
  }

  tell(event) {
    if (!this.pane.metres || !this.steps) return;
    const u = Math.floor(event.offsetX / this.canvas.clientWidth * this.canvas.width);
    const v = Math.floor(event.offsetY / this.canvas.clientHeight * this.canvas.height);
    const step = this.steps[Math.min(v, this.canvas.height - 1) * this.canvas.width + u];
    this.output.textContent = step ? `${(step * this.pane.metres).toFixed(2)} m` : "no depth";
  }
}

// Value of each gaze that the planner compares, with the chosen one.
class GazePane {
  constructor(gaze, run) {
    this.gaze = gaze;
    this.run = run;
    const section = document.createElement("section"), title = document.createElement("h2");
    title.textContent = "Gaze map";
    section.className = "wide gaze";
    section.style.order = 3;
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.output = document.createElement("output");
    section.append(title, this.canvas, this.output);
    byId("pictures").append(section);
  }

  draw(i) {
    const k = lastAt(this.gaze.moments, i), { rows, columns, maps } = this.gaze, zoom = 12;
    this.canvas.width = columns * zoom; this.canvas.height = rows * zoom; // and clears it
    this.canvas.setAttribute("aria-label", "value of each gaze: pan across, tilt down");
    if (k < 0) { this.output.textContent = "none yet"; return; }
    const g = this.canvas.getContext("2d"), [left, right] = [this.gaze.pans[0], this.gaze.pans[columns - 1]];
    const [up, down] = [this.gaze.tilts[0], this.gaze.tilts[rows - 1]];
    for (let row = 0; row < rows; row++) for (let column = 0; column < columns; column++) {
      g.fillStyle = `rgb(${viridis(maps[k][row * columns + column] / 255).map(Math.round)})`;
      // looking left is at the left, looking down at the bottom
      const u = left < right ? columns - 1 - column : column, v = up < down ? row : rows - 1 - row;
      g.fillRect(u * zoom, v * zoom, zoom, zoom);
    }
    this.cross(g, this.run.gaze[i], "#ffffff", zoom);
    this.cross(g, this.run.head[i], "#ff9a56", zoom);
    this.output.textContent = "bright is worth a look; white the chosen gaze, orange the head now";
  }

  cross(g, angles, paint, zoom) {
    if (!angles) return;
    const at = (values, value) => (value - values[0]) / (values[values.length - 1] - values[0]) * (values.length - 1);
    const { pans, tilts, rows, columns } = this.gaze;
    const column = at(pans, angles[0]), row = at(tilts, angles[1]);
    const u = ((pans[0] < pans[columns - 1] ? columns - 1 - column : column) + 0.5) * zoom;
    const v = ((tilts[0] < tilts[rows - 1] ? row : rows - 1 - row) + 0.5) * zoom;
    g.strokeStyle = paint; g.lineWidth = 3; g.beginPath(); g.arc(u, v, 7, 0, 7); g.stroke();
  }
}

// The figures of the moment: one line each.
class Values {
  constructor(run) {
    this.run = run;
    this.cells = [];
    this.complete();
  }

  // A line for every figure that the run has.
  complete() {
    for (const [name, words] of this.run.values.slice(this.cells.length)) {
      const group = document.createElement("div"), term = document.createElement("dt"), value = document.createElement("dd");
      term.textContent = name;
      group.classList.toggle("long", words.some((text) => text && text.length > 18));
      group.append(term, value);
      byId("values").append(group);
      this.cells.push(value);
    }
    byId("now").hidden = !this.cells.length;
  }

  words(i) { return this.run.values.map(([name, words]) => (words[i] ? `${name} ${words[i]}` : "")).filter(Boolean).join("; "); }

  draw(i) { this.run.values.forEach(([, words], k) => { this.cells[k].textContent = words[i] || "–"; }); }
}
