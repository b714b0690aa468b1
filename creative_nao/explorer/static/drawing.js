// What is drawn as SVG or built as elements. All text goes in as text.
import { spoken } from "./engine.js";

const [WIDTH, HEIGHT] = [150, 78];
const ORDER = [4, 5, 6, 7, 0, 1, 2, 3]; // left arm above the right, as columns of a movement

export function make(tag, attributes = {}, children = []) {
  const element = Object.assign(document.createElement(tag), attributes);
  element.append(...(Array.isArray(children) ? children : [children]));
  return element;
}

// Set only what differs, so that a page at rest stays at rest.
export function fill(element, values) {
  for (const [name, value] of Object.entries(values)) if (element[name] !== value) element[name] = value;
}

const height = (angle) => ((HEIGHT * (2.2 - angle)) / 4.4).toFixed(1);
const line = (rows, joint, last, kind, first = 0) => {
  const points = rows.map((row, t) => `${(((first + t) * WIDTH) / last).toFixed(1)},${height(row[joint])}`);
  return `<polyline class="${kind}" points="${points.join(" ")}"/>`;
};

function frame(name, inside) {
  const words = spoken(name).replace(/[^\w ]/g, "");
  return `<svg viewBox="-2 -16 ${WIDTH + 4} ${HEIGHT + 20}" role="img" aria-label="${words} over time"><text class="name" y="-4">${words}</text>
    <rect class="panel-box" width="${WIDTH}" height="${HEIGHT}"/>${inside}<line class="cursor" y2="${HEIGHT}"/></svg>`;
}

const limits = (pair) => pair.map((angle) => `<line class="limit" x2="${WIDTH}" y1="${height(angle)}" y2="${height(angle)}"/>`).join("");

// A movement beside its nearest taught one, an SVG a joint.
export function curvesSvg(memory, recall) {
  const basic = memory.demonstrations[recall.nearest];
  const last = Math.max(recall.angles.length, basic.length) - 1;
  return ORDER.map((joint) => {
    const fast = recall.angles.slice(1).map((_, t) =>
      memory.isFast(recall.angles, t, joint) ? line(recall.angles.slice(t, t + 2), joint, last, "overspeed", t) : "");
    const lines = line(basic, joint, last, "basic") + line(recall.angles, joint, last, "made") + fast.join("");
    return frame(memory.joints[joint], limits(memory.limits[joint]) + lines);
  }).join("");
}

// A movement in the making, an SVG a joint.
export function draftSvg(joints, ranges, angles) {
  return ORDER.map((joint) => frame(joints[joint], limits(ranges[joint]) + line(angles, joint, Math.max(1, angles.length - 1), "made"))).join("");
}

// How far a training has come, on a scale of powers of ten.
export function lossSvg(curve, epochs) {
  const usable = curve.filter(([, loss]) => loss > 0);
  if (!usable.length) return "";
  const powers = usable.map(([, loss]) => Math.log10(loss));
  const [low, high] = [Math.floor(Math.min(...powers)), Math.max(Math.ceil(Math.max(...powers)), Math.floor(Math.min(...powers)) + 1)];
  const points = usable.map(([epoch], k) => `${((300 * epoch) / epochs).toFixed(1)},${((120 * (high - powers[k])) / (high - low)).toFixed(1)}`);
  return `<svg viewBox="-2 -16 304 140" role="img" aria-label="Error while learning, now ${usable.at(-1)[1].toPrecision(2)}">
    <text class="name" y="-4">Error while learning</text><rect class="panel-box" width="300" height="120"/><polyline class="made" points="${points.join(" ")}"/></svg>`;
}

