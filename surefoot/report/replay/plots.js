// Time series with a cursor; a click or a drag goes to that time.

const LINES = ["belief", "moving", "target", "landmark"];
const JOINED = 8; // moments without a value that a line bridges, for sensors that measure now and then
const MARGIN = { left: 44, right: 8, top: 6, bottom: 16 };

class Plot {
  constructor(series, run, seek) {
    this.series = series;
    this.run = run;
    const figure = document.createElement("figure");
    this.caption = document.createElement("figcaption");
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    figure.append(this.caption, this.canvas);
    byId("plots").append(figure);
    const go = (event) => { if (event.buttons) seek(this.timeAt(event.offsetX)); };
    this.canvas.addEventListener("pointerdown", go);
    this.canvas.addEventListener("pointermove", go);
  }

  // The axis fits the values so far.
  scale() {
    const series = this.series, values = series.lines.flatMap((line) => line.values).filter((value) => value !== null);
    let [low, high] = [Infinity, -Infinity];
    for (const value of values) { low = Math.min(low, value); high = Math.max(high, value); }
    const usual = values.sort((a, b) => a - b)[Math.floor(0.95 * values.length)];
    if (series.cut && high > 2 * usual) high = 2 * usual; // a few long frames would flatten the rest
    if (series.zero) low = Math.min(low, 0);
    if (!(high > low)) { high = low + 1; }
    this.step = Plot.tick((high - low) / 3);
    this.low = Math.floor(low / this.step + 1e-9) * this.step;
    this.high = Math.ceil(high / this.step - 1e-9) * this.step;
  }

  static tick(rough) {
    const power = 10 ** Math.floor(Math.log10(rough));
    return [1, 2, 5, 10].map((k) => k * power).find((step) => step >= rough);
  }

  get span() { return Math.max(this.run.t[this.run.t.length - 1], 1e-9); }
  timeAt(u) { return (u - MARGIN.left) / (this.canvas.clientWidth - MARGIN.left - MARGIN.right) * this.span; }

  words(value) { return this.series.unit === "number" ? String(value) : Math.abs(value) < 1000 ? (+value.toFixed(9)).toPrecision(3) : value.toFixed(0); }

  // The curves change with the size only; the cursor is drawn over a stored picture of them.
  curves() {
    this.scale();
    const [g, width, height] = sized(this.canvas), run = this.run;
    this.u = (t) => MARGIN.left + t / this.span * (width - MARGIN.left - MARGIN.right);
    this.v = (value) => height - MARGIN.bottom - (value - this.low) / (this.high - this.low) * (height - MARGIN.top - MARGIN.bottom);
    g.clearRect(0, 0, width, height);
    g.font = "11px sans-serif"; g.fillStyle = theme.soft; g.strokeStyle = theme.line; g.lineWidth = 1; g.textAlign = "right"; g.textBaseline = "middle";
    const digits = Math.max(0, -Math.floor(Math.log10(this.step) + 1e-9));
    for (let value = this.low; value <= this.high + this.step / 2; value += this.step) {
      const v = this.v(value);
      g.beginPath(); g.moveTo(MARGIN.left, v); g.lineTo(width - MARGIN.right, v); g.stroke();
      g.fillText(value.toFixed(digits), MARGIN.left - 5, v);
    }
    const second = Plot.tick(this.span / 6);
    g.textAlign = "center"; g.textBaseline = "top";
    for (let t = 0; t <= this.span; t += second) g.fillText(`${+t.toFixed(2)}${run.by_number ? "" : " s"}`, Math.min(this.u(t), width - 16), height - MARGIN.bottom + 3);
    g.save(); g.beginPath(); g.rect(MARGIN.left, 0, width, height - MARGIN.bottom + 1); g.clip();
    this.series.lines.forEach((line, k) => {
      g.strokeStyle = g.fillStyle = theme[LINES[k % LINES.length]]; g.lineWidth = 1.4; g.beginPath();
      let before = -Infinity;
      line.values.forEach((value, i) => {
        if (value === null) return;
        const [u, v] = [this.u(run.t[i]), this.v(value)];
        const joined = i - before <= JOINED && !run.begins.some((k) => before < k && k <= i);
        if (joined) g.lineTo(u, v); else { g.moveTo(u, v); g.lineTo(u + 0.8, v); }
        before = i;
      });
      g.stroke();
    });
    g.restore();
    this.stored = document.createElement("canvas");
    this.stored.width = this.canvas.width; this.stored.height = this.canvas.height;
    this.stored.getContext("2d").drawImage(this.canvas, 0, 0);
  }

  draw(i) {
    if (this.canvas.clientWidth < 100) return; // not laid out yet
    if (!this.stored) this.curves();
    const [g, , height] = sized(this.canvas);
    g.save(); g.resetTransform(); g.clearRect(0, 0, this.canvas.width, this.canvas.height); g.drawImage(this.stored, 0, 0); g.restore();
    const u = this.u(this.run.t[i]);
    g.strokeStyle = theme.ink; g.lineWidth = 1; g.beginPath(); g.moveTo(u, MARGIN.top); g.lineTo(u, height - MARGIN.bottom); g.stroke();
    this.canvas.dataset.cursor = u.toFixed(1);
    const named = this.series.lines.length > 1;
    this.caption.replaceChildren(`${this.series.name}${this.series.unit ? `, ${this.series.unit}` : ""}: `);
    const words = [];
    this.series.lines.forEach((line, k) => {
      const value = line.values[i], bold = document.createElement("b");
      g.fillStyle = bold.style.color = theme[LINES[k % LINES.length]];
      bold.textContent = `${named ? `${line.name} ` : ""}${value === null ? "–" : this.words(value)}  `;
      words.push(bold.textContent);
      this.caption.append(bold);
      if (value !== null && value <= this.high) { g.beginPath(); g.arc(u, this.v(value), 3, 0, 7); g.fill(); }
    });
    this.canvas.setAttribute("aria-label", `${this.series.name} over time; now ${words.join(", ")}`);
  }
}
