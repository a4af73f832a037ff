// What the grids showed of the ground up to a moment: of every cell the last that was known.

const TALL = 40; // cm, drawn height of an occupied cell whose top was not measured
const OCCUPIED = 127; // of 254: more probably occupied than free

class Ground {
  constructor(run) { this.run = run; this.clear(); }

  clear() { this.entered = 0; this.rows = this.columns = 0; this.cells = null; this.changed = 0; }

  get cell() { return this.run.grid.cell_m; }
  get empty() { return !this.rows; }
  get place() { return [this.left * this.cell, this.bottom * this.cell, this.columns * this.cell, this.rows * this.cell]; }

  // Bring it to moment i; true where it changed.
  at(i) {
    const grid = this.run.grid, wanted = grid ? lastAt(grid.moments, i) + 1 : 0;
    if (wanted === this.entered) return false;
    if (wanted < this.entered) this.clear();
    while (this.entered < wanted) this.enter(this.entered++);
    this.changed += 1;
    return true;
  }

  enter(k) {
    const [, rows, columns, x, y] = this.run.grid.places[k], bytes = this.run.grid.cells[k], size = rows * columns;
    const left = Math.round(x / this.cell), bottom = Math.round(y / this.cell);
    this.reach(left, bottom, columns, rows);
    for (let row = 0; row < rows; row++) for (let column = 0; column < columns; column++) {
      const from = row * columns + column;
      if (bytes[from] === 255) continue;
      const to = 3 * ((bottom + row - this.bottom) * this.columns + left + column - this.left);
      for (let c = 0; c < 3; c++) this.cells[to + c] = bytes[from + c * size];
    }
  }

  reach(left, bottom, columns, rows) {
    const there = this.rows > 0, low = [there ? Math.min(left, this.left) : left, there ? Math.min(bottom, this.bottom) : bottom];
    const high = [Math.max(left + columns, there ? this.left + this.columns : -Infinity), Math.max(bottom + rows, there ? this.bottom + this.rows : -Infinity)];
    const [wide, tall] = [high[0] - low[0], high[1] - low[1]];
    if (there && wide === this.columns && tall === this.rows) return;
    const cells = new Uint8Array(3 * wide * tall);
    for (let k = 0; k < cells.length; k += 3) cells[k] = 255; // never seen
    for (let row = 0; row < this.rows; row++) {
      const from = 3 * row * this.columns, to = 3 * ((this.bottom + row - low[1]) * wide + this.left - low[0]);
      cells.set(this.cells.subarray(from, from + 3 * this.columns), to);
    }
    [this.left, this.bottom] = low;
    [this.columns, this.rows, this.cells] = [wide, tall, cells];
  }

  // The cells as a canvas, the highest y on top: from free to occupied, paler the longer a cell was not seen.
  picture(free, occupied, least) {
    const canvas = document.createElement("canvas");
    canvas.width = this.columns; canvas.height = this.rows;
    const context = canvas.getContext("2d"), image = context.createImageData(this.columns, this.rows);
    for (let row = 0; row < this.rows; row++) for (let column = 0; column < this.columns; column++) {
      const from = 3 * (row * this.columns + column), to = 4 * ((this.rows - 1 - row) * this.columns + column), level = this.cells[from];
      if (level === 255) continue;
      for (let c = 0; c < 3; c++) image.data[to + c] = free[c] + level / 254 * (occupied[c] - free[c]);
      image.data[to + 3] = least + (255 - least) * this.cells[from + 1] / 255;
    }
    context.putImageData(image, 0, 0);
    return canvas;
  }

  // Occupied cells as blocks of their height; sides between blocks of one height are left out.
  blocks(shapes, paint) {
    const step = this.run.grid.height_step_m, cell = this.cell;
    const top = (row, column) => {
      if (row < 0 || column < 0 || row >= this.rows || column >= this.columns) return 0;
      const at = 3 * (row * this.columns + column);
      return this.cells[at] === 255 || this.cells[at] <= OCCUPIED ? 0 : (this.cells[at + 2] || TALL) * step;
    };
    for (let row = 0; row < this.rows; row++) for (let column = 0; column < this.columns; column++) {
      const height = top(row, column);
      if (!height) continue;
      const x = (this.left + column) * cell, y = (this.bottom + row) * cell, [u, v] = [x + cell, y + cell];
      const fresh = 0.55 + 0.45 * this.cells[3 * (row * this.columns + column) + 1] / 255, tint = paint(height).map((value) => value * fresh);
      shapes.face([[x, y, height], [u, y, height], [u, v, height], [x, v, height]], tint, 1, true);
      for (const [beside, a, b] of [[top(row, column + 1), [u, y], [u, v]], [top(row, column - 1), [x, v], [x, y]], [top(row + 1, column), [u, v], [x, v]], [top(row - 1, column), [x, y], [u, y]]]) {
        if (beside < height) shapes.face([[...a, beside], [...b, beside], [...b, height], [...a, height]], tint, 1, true);
      }
    }
  }
}
