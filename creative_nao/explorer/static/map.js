// The map of one memory: cells painted into a canvas, marks over them, and what fingers, wheel and pointer ask for.
import { COLOURS, OUTCOMES, colourOf, isUsable, letter } from "./engine.js";

const SMALLEST = 0.002; // width of the narrowest window
const rgb = (colour) => [1, 3, 5].map((at) => parseInt(colour.slice(at, at + 2), 16));
const WHITE = rgb("#F5F5F5");
const INK = rgb("#22262B");
const PLAIN = ["#009E73", "#E97E00", "#4B0082", "#CD94B5", "#6E6E6E", "#3C4A4F", "#9A9A9A", "#C2003A", "#000000"].map(rgb);
const RAMP = ["#ffffe5", "#f6fbb7", "#d9f0a3", "#addd8e", "#78c679", "#41ab5d", "#238443", "#006837", "#004529"].map(rgb);
export const rampCss = () => `linear-gradient(90deg, ${RAMP.map((c) => `rgb(${c})`).join(", ")})`;
const PATTERNS = [ // whether a pixel belongs to the lines that mark an outcome without colour
  null, null, (y, x) => (y + x) % 8 === 0, (y, x) => (y - x + 8000) % 8 === 0, (_, x) => x % 8 === 0,
  (y, x) => (y % 8) - 4 === 0 && (x % 8) - 4 === 0, (y) => y % 8 === 0,
  (y, x) => ((y % 8) - 4) ** 2 + ((x % 8) - 4) ** 2 <= 5, (y, x) => (y + x) % 8 === 0 || (y - x + 8000) % 8 === 0,
];

export const WHOLE = { left: -1, bottom: -1, width: 2 };

function shade(low, high, share) {
  return low.map((channel, k) => channel + share * (high[k] - channel));
}

function ramp(share) {
  const place = Math.min(Math.max(share, 0), 1) * (RAMP.length - 1);
  const first = Math.min(Math.floor(place), RAMP.length - 2);
  return shade(RAMP[first], RAMP[first + 1], place - first);
}

// The colour of every cell, three bytes each. `span` are the values at the ends of the scale.
function colours(cells, colour, span) {
  const palette = COLOURS.map(rgb);
  const painted = new Uint8Array(3 * cells.n ** 2);
  const values = cells.values[colour];
  for (let cell = 0; cell < cells.n ** 2; cell++) {
    const outcome = cells.outcome[cell];
    let look = PLAIN[outcome];
    if (outcome < 2 && values) look = ramp((values.at[cell] - span[0]) / (span[1] - span[0] || 1));
    else if (outcome < 2 && colour !== "outcome" && colour !== "physical") {
      look = shade(WHITE, palette[cells.nearest[cell] % palette.length], 0.15 + (0.85 * cells.similarity[cell]) / 255);
    }
    painted.set(look, 3 * cell);
  }
  return painted;
}

export class PBMap {
  // `on` has the handlers press(pb, event), drag(pb), release(pb), hover(pb or null, event), zoom(factor, pb), hold(pb, event)
  constructor(host, memory, on) {
    Object.assign(this, { host, memory, on, view: WHOLE, colour: "nearest", marks: {} });
    this.canvas = host.querySelector("canvas");
    this.svg = host.querySelector("svg");
    this.ring = host.querySelector(".ring");
    this.fingers = new Map();
    new ResizeObserver(() => this.paint()).observe(host);
    this.listen();
  }

  show(cells, span, colour = this.colour, view = this.view) {
    Object.assign(this, { cells, span, colour, view });
    this.host.classList.toggle("near", view !== WHOLE); // what lies outside is cut off
    this.paint();
    this.drawMarks();
  }

  paint() {
    const size = Math.min(1000, Math.round(this.host.clientWidth * Math.min(devicePixelRatio, 2)));
    if (!this.cells || !size) return;
    const { cells, view, canvas } = this;
    const painted = colours(cells, this.colour, this.span ?? [0, 1]);
    const place = (k, low, from) => Math.min(cells.n - 1, Math.max(0,
      Math.floor(((low + (k / size) * view.width - from) / cells.width) * cells.n)));
    const column = Array.from({ length: size }, (_, x) => place(x + 0.5, view.left, cells.left));
    const row = Array.from({ length: size }, (_, y) => cells.n * place(size - y - 0.5, view.bottom, cells.bottom));
    const region = (cell) => (cells.outcome[cell] === 0 ? cells.nearest[cell] : -1);
    const picture = new ImageData(size, size);
    const data = picture.data;
    for (let y = 0, at = 0; y < size; y++) {
      for (let x = 0; x < size; x++, at += 4) {
        const cell = row[y] + column[x];
        const outcome = cells.outcome[cell];
        const border = (x && region(cell) !== region(row[y] + column[x - 1])) || (y && region(cell) !== region(row[y - 1] + column[x]));
        const lines = PATTERNS[outcome]?.(y, x) ? 0.35 : 0;
        for (let k = 0; k < 3; k++) {
          data[at + k] = border ? INK[k] : painted[3 * cell + k] + lines * (255 - painted[3 * cell + k]);
        }
        data[at + 3] = 255;
      }
    }
    canvas.width = canvas.height = size;
    canvas.getContext("2d").putImageData(picture, 0, 0);
  }

  pixel([a, b]) {
    const { left, bottom, width } = this.view;
    return [(100 * (a - left)) / width, 100 - (100 * (b - bottom)) / width];
  }

  shows(pb) {
    return this.pixel(pb).every((share) => share >= 0 && share <= 100);
  }

  // The PB point under the pointer, and by how many decimals neighbouring pixels differ.
  point({ clientX, clientY }) {
    const box = this.host.getBoundingClientRect();
    const { left, bottom, width } = this.view;
    const pb = [left + ((clientX - box.left) / box.width) * width, bottom + (1 - (clientY - box.top) / box.height) * width];
    return pb.map((value) => Number(Math.min(1, Math.max(-1, value)).toFixed(this.digits)));
  }

  get digits() {
    return Math.max(3, Math.ceil(-Math.log10(this.view.width / 600)));
  }

  // marks: {points, stars, dots: [[pb, kind]], letters: {R: pb}}; only those that are given change
  mark(marks, glide = false) {
    const hadPath = this.marks.points?.length > 1;
    Object.assign(this.marks, marks);
    this.svg.classList.toggle("glide", glide);
    const onlyRing = Object.keys(marks).join() === "points" && marks.points.length === 1 && !hadPath;
    if (onlyRing) this.placeRing();
    else this.drawMarks();
  }

  drawMarks() {
    const { points = [], stars = [], dots = [], letters = {} } = this.marks;
    const node = (name, attributes, text = "") => {
      const made = document.createElementNS("http://www.w3.org/2000/svg", name);
      for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
      made.textContent = text;
      return made;
    };
    const at = (pb) => this.pixel(pb);
    const seen = (list, of = (item) => item) => list.filter((item) => this.shows(of(item)));
    const basic = this.memory.pb.map((pb, place) => [letter(place), pb]);
    this.svg.querySelector("g").replaceChildren(
      ...seen(dots, ([pb]) => pb).map(([pb, kind]) => node("circle", { cx: at(pb)[0], cy: at(pb)[1], r: 1.1, class: `dot ${kind}` })),
      ...seen([...basic, ...Object.entries(letters)], ([, pb]) => pb).map(([text, pb]) =>
        node("text", { x: at(pb)[0], y: at(pb)[1], dy: "0.35em", class: "letter" }, text)),
      ...seen(stars).map((pb) => node("text", { x: at(pb)[0], y: at(pb)[1], dy: "0.35em", class: "star" }, "★")),
      ...(points.length > 1 ? ["under", "over"] : []).map((kind) =>
        node("polyline", { points: points.map((pb) => at(pb).join(",")).join(" "), class: `path ${kind}` })),
    );
    this.placeRing();
  }

  placeRing() {
    const pb = this.marks.points?.at(-1);
    if (!pb) return;
    const [x, y] = this.pixel(pb);
    this.ring.style.transform = `translate(${x}px, ${y}px)`;
    this.ring.style.visibility = this.shows(pb) ? "visible" : "hidden";
  }

  listen() {
    const { host, fingers, on } = this;
    let holding = 0;
    let apart = 0;
    let dragging = false;
    const spread = () => {
      const [a, b] = [...fingers.values()];
      return Math.max(1, Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY));
    };
    const middle = () => {
      const [a, b] = [...fingers.values()];
      return this.point({ clientX: (a.clientX + b.clientX) / 2, clientY: (a.clientY + b.clientY) / 2 });
    };
    host.addEventListener("pointerdown", (event) => {
      if (event.button > 0) return;
      fingers.set(event.pointerId, event);
      if (event.isTrusted) host.setPointerCapture(event.pointerId);
      clearTimeout(holding);
      if (fingers.size === 2) {
        dragging = false;
        apart = spread();
        return;
      }
      dragging = true;
      if (event.pointerType === "touch") holding = setTimeout(() => on.hold(this.point(event), event), 500);
      on.press(this.point(event), event);
    });
    host.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) {
        if (event.pointerType !== "touch") on.hover(this.point(event), event);
        return;
      }
      const before = fingers.get(event.pointerId);
      if (Math.hypot(event.clientX - before.clientX, event.clientY - before.clientY) > 6) clearTimeout(holding);
      if (fingers.size === 2) {
        fingers.set(event.pointerId, event);
        const now = spread();
        if (Math.abs(Math.log(now / apart)) > 0.05) {
          on.zoom(now / apart, middle());
          apart = now;
        }
      } else if (dragging) on.drag(this.point(event), event);
    });
    const lift = (event) => {
      clearTimeout(holding);
      if (!fingers.delete(event.pointerId) || !dragging || fingers.size) return;
      dragging = false;
      on.release(this.point(event), event);
    };
    host.addEventListener("pointerup", lift);
    host.addEventListener("pointercancel", lift);
    host.addEventListener("pointerleave", () => on.hover(null));
    host.addEventListener("wheel", (event) => {
      if (event.deltaY > 0 && this.view === WHOLE && !event.ctrlKey) return; // the page scrolls on
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 30 : 1;
      on.zoom(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 6 : 1) * 0.003), this.point(event));
    }, { passive: false });
  }
}

// The view `factor` times nearer round a point that keeps its place; WHOLE when all is seen.
export function zoomed(view, factor, around) {
  const width = Math.max(Math.min(view.width, 2) / factor, SMALLEST);
  if (width >= 2) return WHOLE;
  const [left, bottom] = [view.left, view.bottom].map((low, k) =>
    Math.min(Math.max(around[k] - ((around[k] - low) * width) / view.width, -1), 1 - width));
  return { left, bottom, width };
}

export function following(view, [a, b]) {
  const inside = (value, low) => value >= low && value <= low + view.width;
  if (inside(a, view.left) && inside(b, view.bottom)) return view;
  const [left, bottom] = [a, b].map((value) => Math.min(Math.max(value - view.width / 2, -1), 1 - view.width));
  return { ...view, left, bottom };
}

// The entries of a legend: [css background, words].
export function legend(memory, cells, colour) {
  const n = cells.n ** 2;
  const shares = OUTCOMES.map(() => 0);
  for (const outcome of cells.outcome) shares[outcome] += 100 / n;
  const entries = [];
  if (!["outcome", "physical"].includes(colour) && !cells.values[colour]) {
    entries.push(...memory.names.map((name, place) => [colourOf(place), `${letter(place)} ${name}`]));
  }
  OUTCOMES.forEach((outcome, code) => {
    const shown = colour === "outcome" || colour === "physical" || !isUsable(outcome);
    if (shown && shares[code] > 0) entries.push([`rgb(${PLAIN[code]})`, `${LEGEND[outcome]} ${shares[code].toFixed(0)} %`]);
  });
  return entries;
}

const LEGEND = {
  learned: "taught", unlearned: "new", fluctuating: "too fast", non_moving: "hardly moves", joint_limit: "out of reach",
  torque_saturated: "motors at their limit", tracking_error: "arms cannot follow", self_collision: "touches itself",
  fell: "falls",
};
