// The memory in the page: its network (Eq. 1-3, 5, 7), what a movement is worth, and the words for it.
// creative_nao.model and creative_nao.measures define all of it; tests/explorer/test_engine.py holds it to their arrays.

export const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const floats = (text) => new Float32Array(bytes(text).buffer);
const { fround } = Math;
const clamp = (value, low = -1, high = 1) => Math.min(high, Math.max(low, value));
export const letter = (place) => String.fromCharCode(65 + (place % 26));
export const COLOURS = ["#004FE5", "#E97E00", "#009E73", "#8B2F00", "#66D6FF", "#EDD912"];
export const colourOf = (place) => COLOURS[place % COLOURS.length];
export const OUTCOMES = [
  "learned", "unlearned", "fluctuating", "non_moving",
  "joint_limit", "torque_saturated", "tracking_error", "self_collision", "fell",
];
export const CHIPS = {
  learned: "Taught", unlearned: "New", fluctuating: "Too fast", non_moving: "Hardly moves", joint_limit: "Out of reach",
  torque_saturated: "Too heavy", tracking_error: "Cannot follow", self_collision: "Hits itself", fell: "Falls",
};
export const isUsable = (outcome) => outcome === "learned" || outcome === "unlearned";

export class Memory {
  // `data` is what explorer.page_data.memory_data gives
  constructor(data) {
    Object.assign(this, data);
    const w = Object.fromEntries(Object.entries(data.weights).map(([name, text]) => [name, floats(text)]));
    this.references = floats(data.references);
    this.rate = floats(data.rate);
    this.firstCode = floats(data.firstCode);
    const [n, nCodes, nFast] = [this.rate.length, this.firstCode.length, this.nFast];
    this.nHidden = n;
    this.nCodes = nCodes;
    this.weights = {
      ...w,
      hidden: transposed(w.w_hidden, n, n), // a row a receiving unit: sums run along memory
      in: transposed(w.w_in, nCodes, nFast),
      out: transposed(w.w_out, nFast, nCodes),
    };
    this.nJoints = this.joints.length;
    this.basic = this.demonstrations.map((rows) => Float64Array.from(rows.flat()));
  }

  // Joint angles [rad], one row of joints a tick; pbAt(tick) is the PB that drives this tick. The closed loop amplifies
  // rounding, so this rounds as model/compiled_generation.py does: float32, each sum one multiply-add after the other.
  generate(pbAt, nSteps = this.nSteps) {
    const { nHidden, nCodes, nFast, nUnits, rate, weights: w } = this;
    const u = new Float32Array(nHidden);
    let [y, next] = [new Float32Array(nHidden), new Float32Array(nHidden)];
    let [code, predicted] = [this.firstCode.slice(), new Float32Array(nCodes)];
    const angles = [Float64Array.from(this.firstPosture)];
    for (let tick = 1; tick < nSteps; tick++) {
      for (let j = 0; j < nCodes; j++) {
        let sum = w.b_out[j];
        for (let i = 0, at = j * nFast; i < nFast; i++) sum = fround(y[i] * w.out[at + i] + sum);
        predicted[j] = sum;
      }
      const [pb1, pb2] = pbAt(tick).map(fround);
      for (let i = 0; i < nHidden; i++) {
        let sum = fround(pb2 * w.w_pb[nHidden + i] + fround(pb1 * w.w_pb[i] + w.b_hidden[i]));
        if (i < nFast) for (let k = 0, at = i * nCodes; k < nCodes; k++) sum = fround(code[k] * w.in[at + k] + sum);
        for (let k = 0, at = i * nHidden; k < nHidden; k++) sum = fround(y[k] * w.hidden[at + k] + sum);
        u[i] = fround(fround(1 - rate[i]) * u[i] + fround(rate[i] * sum));
        next[i] = tanh32(u[i]);
      }
      angles.push(this.decode(predicted));
      [y, next] = [next, y];
      [code, predicted] = [predicted, code];
    }
    return angles;
  }

  // Turn summed inputs into shares of each joint's units, in place, and these into angles.
  decode(code) {
    const angles = new Float64Array(this.nJoints);
    for (let joint = 0, first = 0; joint < this.nJoints; joint++, first += this.nUnits) {
      const end = first + this.nUnits;
      let top = code[first];
      for (let k = first; k < end; k++) top = Math.max(top, code[k]);
      let total = 0;
      for (let k = first; k < end; k++) total = fround(total + (code[k] = exp32(fround(code[k] - top))));
      const inverse = fround(1 / total);
      let angle = 0;
      for (let k = first; k < end; k++) {
        code[k] *= inverse;
        angle = fround(code[k] * this.references[k] + angle);
      }
      angles[joint] = angle;
    }
    return angles;
  }

  // The movement along straight lines through the points, reached at even times; one point is a constant PB.
  recall(points) {
    const last = points.length - 1;
    const pbAt = (tick) => {
      const place = (tick / Math.max(1, this.nSteps - 1)) * last;
      const first = Math.min(Math.floor(place), Math.max(0, last - 1));
      const [a, b] = [points[first], points[Math.min(first + 1, last)]];
      return [a[0] + (place - first) * (b[0] - a[0]), a[1] + (place - first) * (b[1] - a[1])];
    };
    return { points, ...this.evaluate(this.generate(pbAt)) };
  }

  // What measures.score says of a movement.
  evaluate(angles) {
    const flat = Float64Array.from(angles.flatMap((row) => [...row]));
    const distances = this.basic.map((basic) => dtw(flat, basic, this.nJoints));
    const novelty = Math.min(...distances);
    const n = this.nJoints;
    let fastest = { excess: 0 };
    let travel = 0;
    for (let j = 0; j < n; j++) {
      let [low, high] = [Infinity, -Infinity];
      for (let t = 0; t < angles.length; t++) {
        const angle = flat[t * n + j];
        low = Math.min(low, angle);
        high = Math.max(high, angle);
        if (!t) continue;
        const speed = Math.abs(angle - flat[(t - 1) * n + j]) / this.dt;
        const excess = speed / this.speedLimit[j];
        if (excess > fastest.excess) fastest = { excess, speed, joint: j, tick: t - 1 };
      }
      travel = Math.max(travel, high - low);
    }
    const outcome = fastest.excess > 1 + 1e-12 ? "fluctuating"
      : travel < this.travelLimit ? "non_moving"
      : novelty <= this.learnedThreshold ? "learned" : "unlearned";
    return { angles, novelty, nearest: distances.indexOf(novelty), outcome, fastest, travel };
  }

  isFast(angles, tick, joint) {
    const speed = Math.abs(angles[tick + 1][joint] - angles[tick][joint]) / this.dt;
    return speed > this.speedLimit[joint] * (1 + 1e-12);
  }

  // From 0, a taught movement itself, over 1/2, where taught ends, to 1, like nothing that was taught.
  share(novelty) {
    return 1 - 2 ** (-novelty / this.learnedThreshold);
  }

  // What is said of a movement: `kind` (its outcome), `chip` and `text`. `body` is what physics found, if it was asked.
  describe(recall, body = null) {
    const like = this.names[recall.nearest];
    const kind = body?.failure && recall.outcome !== "fluctuating" ? body.failure : recall.outcome;
    const how = { learned: "This is", unlearned: "Nobody taught it. Most like" }[recall.outcome];
    let text = how ? `${how} ${like}.` : "";
    if (recall.outcome === "learned") text = `Close to ${like}, which the robot was taught.`;
    if (recall.outcome === "fluctuating") {
      const { speed, joint, tick } = recall.fastest;
      text = `Faster than the motors: ${spoken(this.joints[joint])} reaches ${speed.toFixed(1)} rad/s after `
        + `${(tick * this.dt).toFixed(1)} s, the limit is ${this.speedLimit[joint].toFixed(1)}. Most like ${like}.`;
    }
    if (recall.outcome === "non_moving") text = `The robot hardly moves: ${recall.travel.toFixed(2)} rad at most.`;
    if (recall.points?.length > 1) text = `Path of ${recall.points.length} points. ${text}`;
    if (body) text += ` ${BODY[body.failure] ?? (recall.outcome === "fluctuating" ? SLOWED : "The body can do it.")} ${hits(body)}`;
    return { kind, chip: CHIPS[kind], text };
  }
}

// "RElbowRoll" in words: "right elbow roll".
export const spoken = (joint) => joint.replace(/^R/, "right").replace(/^L/, "left").replace(/[A-Z]/g, (letter) => ` ${letter.toLowerCase()}`);
const SLOWED = "In the simulation the motors turned as fast as they can, and the robot stayed on its feet.";
const BODY = {
  joint_limit: "The body cannot: a joint would leave its range.",
  torque_saturated: "The body cannot: its motors are at their limit.",
  tracking_error: "The body cannot: the arms do not follow.",
  self_collision: "The body cannot: it touches itself.",
  fell: "The robot falls.",
};
const hits = ({ hits }) => {
  if (!hits.length) return "The bag is not hit.";
  const hardest = Math.max(...hits.map(([, newton]) => newton));
  return `${hits.length} ${hits.length > 1 ? "hits" : "hit"} of the bag, the hardest with ${hardest.toFixed(0)} N.`;
};

const polynomial = (x, factors) => factors.reduce((sum, factor) => fround(sum * x + factor));
const EXP = [1 / 5040, 1 / 720, 1 / 120, 1 / 24, 1 / 6, 0.5, 1, 1].map(fround);
const TANH_P = [1.318426523511107e-8, 2.0471863535931334e-5, 0.003486584173515439, 0.13373199105262756, 0.9999998807907104].map(fround);
const TANH_Q = [7.702681159571512e-7, 0.00032713887048885226, 0.025841986760497093, 0.4670649766921997, 1].map(fround);
const [PER_LN_2, LN_2_HIGH, LN_2_LOW] = [1.4426950408889634, 0.693359375, -2.12194440e-4].map(fround);

// As model/simd.py has them.
function exp32(value) {
  const x = Math.max(value, -87);
  const n = Math.floor(fround(x * PER_LN_2 + 0.5));
  return fround(polynomial(fround(fround(x - n * LN_2_HIGH) - n * LN_2_LOW), EXP) * 2 ** n);
}

function tanh32(value) {
  const x = Math.min(Math.max(value, -9), 9);
  const z = fround(x * x);
  return fround(fround(x * polynomial(z, TANH_P)) / polynomial(z, TANH_Q));
}

function transposed(matrix, rows, columns) {
  const turned = new Float64Array(matrix.length);
  for (let i = 0; i < rows; i++) for (let j = 0; j < columns; j++) turned[j * rows + i] = matrix[i * columns + j];
  return turned;
}

function apart(one, at, other, to, n) {
  let sum = 0;
  for (let k = 0; k < n; k++) sum += (one[at + k] - other[to + k]) ** 2;
  return Math.sqrt(sum);
}

// Dynamic time warping of two movements, flat: Euclidean distances between postures summed along the best path.
export function dtw(one, other, n) {
  const width = other.length / n;
  let [before, now] = [new Float64Array(width + 1).fill(Infinity), new Float64Array(width + 1)];
  before[0] = 0;
  for (let t = 0; t < one.length; t += n) {
    now[0] = Infinity;
    for (let j = 0; j < width; j++) {
      now[j + 1] = apart(one, t, other, j * n, n) + Math.min(before[j], before[j + 1], now[j]);
    }
    [before, now] = [now, before];
  }
  return before[width];
}

const WINDOW_S = 1.5;
const SWITCH_COST = 1.0;

// Which basic action a movement resembles when, as measures.attribution defines it: [{first, end, action, rows}].
export function stretches(angles, memory) {
  const matrix = alignments(angles, memory);
  const from = [];
  let total = matrix[0].slice();
  for (const row of matrix.slice(1)) {
    const best = total.indexOf(Math.min(...total));
    const changes = total.map((value) => total[best] + SWITCH_COST < value);
    from.push(changes.map((change, k) => (change ? best : k)));
    total = total.map((value, k) => (changes[k] ? total[best] + SWITCH_COST : value) + row[k]);
  }
  const named = [total.indexOf(Math.min(...total))];
  for (let t = from.length - 1; t >= 0; t--) named.unshift(from[t][named[0]]);
  const parts = [];
  named.forEach((action, t) => {
    if (parts.at(-1)?.action !== action) parts.push({ first: t, action, distances: [] });
    parts.at(-1).end = t + 1;
    parts.at(-1).distances.push(matrix[t][action]);
  });
  return parts;
}

// Distance per posture of each tick's best window from each basic action [rad].
export function alignments(angles, memory) {
  const n = memory.nJoints;
  const flat = Float64Array.from(angles.flatMap((row) => [...row]));
  const window = Math.min(Math.max(2, Math.round(WINDOW_S / memory.dt)), angles.length);
  const matrix = angles.map(() => memory.basic.map(() => Infinity));
  memory.basic.forEach((action, place) => {
    const width = action.length / n;
    const cost = angles.map((_, t) => Float64Array.from({ length: width }, (_, j) => apart(flat, t * n, action, j * n, n)));
    for (let first = 0; first + window <= angles.length; first++) {
      let before = cost[first].slice(); // a window may begin anywhere on the action
      for (let i = 1; i < window; i++) {
        const now = new Float64Array(width);
        for (let j = 0; j < width; j++) {
          now[j] = cost[first + i][j] + (j ? Math.min(before[j], before[j - 1], now[j - 1]) : before[0]);
        }
        before = now;
      }
      const mean = before.reduce((a, b) => Math.min(a, b)) / window;
      for (let t = first; t < first + window; t++) matrix[t][place] = Math.min(matrix[t][place], mean);
    }
  });
  return matrix;
}

// What the stretches say: "Like A left jab until 2.2 s, then like C left hook."
export function sentence(parts, memory) {
  const words = parts.map(({ end, action }, k) => {
    const until = k < parts.length - 1 ? ` until ${((end - 0.5) * memory.dt).toFixed(1)} s` : "";
    return `like ${memory.names[action]}${until}`;
  });
  const text = words.join(", then ");
  return `${text[0].toUpperCase()}${text.slice(1)}.`;
}

// The scored cells of a square of the PB space, as explorer.registry.cells_json gives them.
export class Cells {
  static async from({ n, left, bottom, width, outcome, nearest, similarity, values, names }) {
    const cells = Object.assign(new Cells(), { n, left, bottom, width, values: {} });
    [cells.outcome, cells.nearest, cells.similarity] = await Promise.all([outcome, nearest, similarity].map(inflated));
    for (const [name, number] of Object.entries(values ?? {})) await cells.add(name, number);
    return cells;
  }

  async add(name, { plane, low, high }) {
    const steps = await inflated(plane);
    this.values[name] = { low, high, at: Float32Array.from(steps, (step) => low + (step / 255) * (high - low)) };
  }

  cell([a, b]) {
    const [column, row] = [(a - this.left) / this.width, (b - this.bottom) / this.width]
      .map((share) => clamp(Math.floor(share * this.n), 0, this.n - 1));
    return row * this.n + column;
  }

  point(cell) {
    return [(cell % this.n) + 0.5, Math.floor(cell / this.n) + 0.5]
      .map((place, k) => clamp((k ? this.bottom : this.left) + (place / this.n) * this.width));
  }

  covers(view) {
    return ["left", "bottom"].every((side) => {
      const offset = view[side] - this[side];
      return offset >= -1e-9 && offset <= this.width - view.width + 1e-9;
    });
  }

  // A cell drawn with these weights, as a PB point; null if there is none.
  draw(weight) {
    const weights = Float64Array.from({ length: this.n ** 2 }, (_, cell) => weight(cell, this.point(cell)));
    let left = Math.random() * weights.reduce((a, b) => a + b, 0);
    if (!(left > 0)) return null;
    return this.point(weights.findIndex((value) => (left -= value) < 0));
  }

  isUsable(cell) {
    return this.outcome[cell] < 2;
  }

  surprise() {
    return this.draw((cell) => (this.outcome[cell] === 1 ? 1 : 0));
  }

  moreLike(point) {
    const squared = ([a, b]) => ((a - point[0]) ** 2 + (b - point[1]) ** 2) / 0.12 ** 2;
    return this.draw((cell, here) => (this.isUsable(cell) && squared(here) > 1e-3 ? Math.exp(-squared(here) / 2) : 0));
  }

  lessLike(point) {
    const away = ([a, b]) => Math.hypot(a - point[0], b - point[1]);
    const farthest = Math.max(...[-1, 1].flatMap((a) => [-1, 1].map((b) => away([a, b]))));
    return this.draw((cell, here) => (this.isUsable(cell) ? (away(here) / farthest) ** 8 : 0));
  }
}

async function inflated(text) {
  const stream = new Blob([bytes(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
