// The colours of the map: a byte a cell and a palette for each colouring, painted into a canvas of a pixel a cell.

const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

async function unpacked({ plane, n }) {
  const stream = new Blob([bytes(plane)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const steps = new Uint8Array(await new Response(stream).arrayBuffer());
  for (let cell = 0; cell < steps.length; cell++) if (cell % n) steps[cell] += steps[cell - 1]; // modulo 256
  return steps;
}

export class Colouring {
  constructor({ levels, textures, sheets }, canvas, texture) {
    Object.assign(this, { levels, textures, sheets, canvas, texture });
  }

  // Paint in the colours of a sheet; true unless another was asked for meanwhile.
  async choose(name) {
    const sheet = (this.wanted = this.sheets.find((one) => one.name === name));
    sheet.cells ??= await unpacked(sheet);
    if (sheet !== this.wanted) return false;
    const { n, cells } = sheet;
    const palette = bytes(sheet.palette);
    const picture = new ImageData(n, n);
    cells.forEach((byte, cell) => {
      const pixel = 4 * ((n - 1 - Math.floor(cell / n)) * n + (cell % n)); // PB 2 upwards
      picture.data.set([...palette.subarray(3 * byte, 3 * byte + 3), 255], pixel);
    });
    this.canvas.width = this.canvas.height = n;
    this.canvas.getContext("2d").putImageData(picture, 0, 0);
    this.texture.src = this.textures[sheet.texture];
    for (const layer of [this.canvas, this.texture]) {
      layer.style.inset = `${-50 / (n - 1)}%`; // the cells at the edges reach half a cell beyond the PB space
      layer.style.width = layer.style.height = `${(100 * n) / (n - 1)}%`;
    }
    this.shown = sheet;
    return true;
  }

  // What the colour of the cell of a PB point says, if it is a number.
  tell(pb) {
    const { n, cells, label, low, high } = this.shown ?? {};
    if (!label) return "";
    const [column, row] = pb.map((value) => Math.round(((value + 1) / 2) * (n - 1)));
    const byte = cells[row * n + column];
    if (byte >= this.levels) return `${label}: none, the movement cannot be used`;
    return `${label}: ${Number((low + ((byte + 0.5) / this.levels) * (high - low)).toPrecision(3))}`;
  }
}
