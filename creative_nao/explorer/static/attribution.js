// Which basic action a movement resembles when, as creative_nao.measures.attribution defines it.
export const WINDOW_S = 1.5;
const SWITCH_COST = 1.0;
const HALF_RAD = 0.2;
const COLOURS = ["#004FE5", "#E97E00", "#009E73", "#8B2F00", "#66D6FF", "#EDD912"];

// Distance per posture of each tick's best window from each basic action [rad].
export function distances(angles, demonstrations, dt) {
  const window = Math.min(Math.max(2, Math.round(WINDOW_S / dt)), angles.length);
  const matrix = angles.map(() => demonstrations.map(() => Infinity));
  demonstrations.forEach((action, place) => {
    const cost = angles.map((posture) => action.map((other) => Math.hypot(...posture.map((v, k) => v - other[k]))));
    for (let first = 0; first + window <= angles.length; first++) {
      let before = cost[first].slice(); // a window may begin anywhere on the action
      for (let i = 1; i < window; i++) {
        const now = [];
        before.forEach((value, j) => {
          const least = j ? Math.min(value, before[j - 1], now[j - 1]) : value;
          now.push(least + cost[first + i][j]);
        });
        before = now;
      }
      const mean = Math.min(...before) / window;
      for (let t = first; t < first + window; t++) matrix[t][place] = Math.min(matrix[t][place], mean);
    }
  });
  return matrix;
}

// One action a tick: the sequence whose distances, plus a cost for each change, are smallest.
export function stretches(matrix) {
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
    if (parts.at(-1)?.action !== action) parts.push({ first: t, end: t, action });
    parts.at(-1).end = t + 1;
  });
  return parts;
}

// The strip and its sentence as HTML; names are those of the page itself.
export function strip(angles, memory) {
  const matrix = distances(angles, memory.demonstrations, memory.dt);
  const parts = stretches(matrix);
  const last = Math.max(1, angles.length - 1);
  const share = (tick) => (100 * Math.min(Math.max(tick - 0.5, 0), last)) / last;
  const letter = (action) => String.fromCharCode(65 + (action % 26));
  const blocks = parts.map(({ first, end, action }) => {
    const width = (end === angles.length ? 100 : share(end)) - share(first);
    const [r, g, b] = COLOURS[action % COLOURS.length].match(/\w\w/g).map((pair) => parseInt(pair, 16));
    const shades = matrix.slice(first, end).map((row) => `rgba(${r},${g},${b},${0.15 + 0.85 * 2 ** (-row[action] / HALF_RAD)})`);
    if (shades.length < 2) shades.push(shades[0]);
    const background = `linear-gradient(90deg,${shades.join(",")})`;
    return `<b style="left:${share(first)}%;width:${width}%;background:${background}">${width >= 4 ? letter(action) : ""}</b>`;
  });
  const text = (name) => name.replace(/[&<>"']/g, (mark) => `&#${mark.charCodeAt(0)};`);
  const words = parts.map(({ end, action }, k) => {
    const until = k < parts.length - 1 ? ` to ${((end - 0.5) * memory.dt).toFixed(1)} s` : "";
    return `${letter(action)} ${text(memory.names[action])}${until}`;
  });
  return `<div class="cn-strip" aria-hidden="true">${blocks.join("")}<i class="cn-strip-cursor"></i></div>
    <div class="cn-legend cn-resembles">Resembles ${words.join(", then ")}.</div>`;
}
