// The PB-MTRNN running in the page: closed-loop generation (Eq. 1-3, 5, 7) and what a movement is worth.

const floats = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

export class Memory {
  constructor(data) {
    Object.assign(this, data); // names, joints, dt, nSteps, nUnits, pb, demonstrations, limits, thresholds
    this.weights = Object.fromEntries(Object.entries(data.weights).map(([name, text]) => [name, floats(text)]));
    this.references = floats(data.references);
    this.rate = floats(data.rate);
    this.firstCode = floats(data.firstCode);
    this.nHidden = this.rate.length;
    this.nCodes = this.firstCode.length;
  }

  // Joint angles [rad], one array of joints a tick; pbAt(tick) is the PB that drives this tick.
  generate(pbAt, nSteps = this.nSteps) {
    const { nHidden, nCodes, nFast, nUnits, weights: w } = this;
    const u = new Float64Array(nHidden);
    let y = new Float64Array(nHidden);
    let code = Float64Array.from(this.firstCode);
    const angles = [this.firstPosture.slice()];
    for (let tick = 1; tick < nSteps; tick++) {
      const predicted = new Float64Array(nCodes);
      for (let j = 0; j < nCodes; j++) {
        let sum = w.b_out[j];
        for (let i = 0; i < nFast; i++) sum += y[i] * w.w_out[i * nCodes + j];
        predicted[j] = sum;
      }
      for (let start = 0; start < nCodes; start += nUnits) {
        const group = predicted.subarray(start, start + nUnits);
        const most = Math.max(...group);
        let total = 0;
        for (let k = 0; k < nUnits; k++) total += group[k] = Math.exp(group[k] - most);
        for (let k = 0; k < nUnits; k++) group[k] /= total;
      }
      const pb = pbAt(tick);
      const next = new Float64Array(nHidden);
      for (let i = 0; i < nHidden; i++) {
        let sum = w.b_hidden[i] + pb[0] * w.w_pb[i] + pb[1] * w.w_pb[nHidden + i];
        for (let k = 0; k < nHidden; k++) sum += y[k] * w.w_hidden[k * nHidden + i];
        if (i < nFast) for (let k = 0; k < nCodes; k++) sum += code[k] * w.w_in[k * nFast + i];
        u[i] = (1 - this.rate[i]) * u[i] + this.rate[i] * sum;
        next[i] = Math.tanh(u[i]);
      }
      y = next;
      code = predicted;
      angles.push(this.decode(code));
    }
    return angles;
  }

  decode(code) {
    const angles = [];
    for (let start = 0; start < code.length; start += this.nUnits) {
      let sum = 0;
      for (let k = 0; k < this.nUnits; k++) sum += code[start + k] * this.references[start + k];
      angles.push(sum);
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
      return [0, 1].map((k) => a[k] + (place - first) * (b[k] - a[k]));
    };
    return this.evaluate(this.generate(pbAt));
  }

  evaluate(angles) {
    const distances = this.demonstrations.map((basic) => dtw(angles, basic));
    const novelty = Math.min(...distances);
    const speeds = angles.slice(1).map((row, t) => row.map((value, j) => Math.abs(value - angles[t][j]) / this.dt));
    const travel = Math.max(...this.joints.map((_, j) => {
      const column = angles.map((row) => row[j]);
      return Math.max(...column) - Math.min(...column);
    }));
    const fast = speeds.some((row) => row.some((value, j) => value > this.speedLimit[j] * (1 + 1e-12)));
    const outcome = fast ? "fluctuating"
      : travel < this.travelLimit ? "non_moving"
      : novelty <= this.learnedThreshold ? "learned" : "unlearned";
    return { angles, speeds, novelty, nearest: distances.indexOf(novelty), outcome };
  }
}

// Dynamic time warping: Euclidean distances between postures summed along the best path.
export function dtw(one, other) {
  let before = new Float64Array(other.length + 1).fill(Infinity);
  before[0] = 0;
  for (const posture of one) {
    const now = new Float64Array(other.length + 1).fill(Infinity);
    other.forEach((target, j) => {
      const cost = Math.hypot(...posture.map((value, k) => value - target[k]));
      now[j + 1] = cost + Math.min(before[j], before[j + 1], now[j]);
    });
    before = now;
  }
  return before[other.length];
}
