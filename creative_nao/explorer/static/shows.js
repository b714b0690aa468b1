// What the page shows by itself: a tour of surprises that a trained agent found, and two agents racing.
import { $, app, setBeside, show, source, surprise, toast, waiting } from "./page.js";
import { CHIPS, sentence, stretches } from "./engine.js";
import { Stage } from "./robot.js";
import { make } from "./drawing.js";

let stopped = () => {};

// A panel over the page with a title and a way to end; `ended` is called once, whatever ends it.
export function sheet(title, children, next, ended = () => {}, word = "End") {
  stopped();
  const box = $("stop");
  const close = make("button", { className: "quiet" }, word);
  close.addEventListener("click", () => stopped());
  box.replaceChildren(make("h2", {}, title), ...children, make("div", { className: "row" }, [...next, make("span", { className: "gap" }), close]));
  box.setAttribute("aria-label", title);
  box.hidden = false;
  document.body.classList.toggle("staged", app.panels.length > 0);
  const run = { over: false };
  stopped = () => {
    run.over = true;
    box.hidden = true;
    document.body.classList.remove("staged");
    app.panels[0].map?.mark({ dots: runDots() });
    stopped = () => {};
    ended();
  };
  return run;
}

export const runDots = () => app.panels[0].dots.map((pb) => [pb, ""]);
const tries = (agent, seed = 1) => source.agent(agent, app.panels[0].name, seed);

// Four surprises: of what the agent earned most with, those that lie apart.
export async function tour() {
  const { memory, agents: { guide } } = app.panels[0];
  const [agent] = spokenNames([guide]);
  const played = await waiting(() => tries(guide), $("tour"));
  const found = [];
  for (const one of [...(played?.tries ?? [])].sort((a, b) => b.reward - a.reward)) {
    const apart = found.every(({ pb }) => Math.hypot(pb[0] - one.pb[0], pb[1] - one.pb[1]) > 0.15);
    if (found.length < 4 && apart && memory.recall([one.pb]).outcome === "unlearned") found.push(one);
  }
  if (!found.length) {
    toast("No agent found a surprise in this memory; here is one drawn at random.");
    return surprise();
  }
  step(0);

  function step(place) {
    const { pb, reward } = found[place];
    const recall = memory.recall([pb]);
    show([pb]);
    const parts = stretches(recall.angles, memory);
    const words = parts.length > 1 ? sentence(parts, memory) : `Of what it was taught, ${memory.names[recall.nearest]} comes nearest.`;
    const last = place === found.length - 1;
    const next = make("button", { className: "primary" }, last ? "Explore yourself" : "Next");
    next.addEventListener("click", () => (last ? stopped() : step(place + 1)));
    sheet(`Surprise ${place + 1} of ${found.length}`, [
      make("p", {}, `The agent ${agent} found this movement; nobody taught it. ${words} Reward for how different it is: ${reward.toFixed(1)}.`),
    ], [next]);
    next.focus();
  }
}

const spokenName = (name) => name.replace(/^run:/, "");
// Without the environment that they were trained in, where that tells them apart.
function spokenNames(names) {
  const short = names.map((name) => spokenName(name).replace(/\/[^@]*/, ""));
  return new Set(short).size === names.length ? short : names.map(spokenName);
}
const RACERS = ["White", "Yellow"];
const [FIRST_TURNS, SLOW_MS, FAST_MS, RACE_SPEED] = [3, 1700, 850, 3.5];

function choice(k, groups, pair, again) {
  const list = make("select", { ariaLabel: `${RACERS[k]} dots` }, groups.map(([title, names]) => {
    const options = names.map((name) => new Option(spokenName(name), name, false, name === pair[k]));
    return title ? make("optgroup", { label: title }, options) : options;
  }).flat());
  list.addEventListener("change", () => again(pair.map((name, place) => (place === k ? list.value : name))));
  return list;
}

// Two agents explore before your eyes, a robot for each, try by try, and are paid for what is new.
export async function race(pair = app.panels[0].agents.pair, seed = 1, sign = $("race")) {
  const played = await waiting(() => Promise.all(pair.map((name) => tries(name, seed))), sign);
  if (!played) return;
  stopped();
  if (app.panels.length > 1) await setBeside("");
  const [panel] = app.panels;
  const { groups } = panel.agents;
  const names = spokenNames(pair);
  const racers = played.map((one, k) => ({
    ...one, name: names[k], total: 0, bar: make("i"), score: make("b", { className: "figures" }, "0.0"),
    words: make("span", { className: `of ${"ab"[k]}` }, names[k]), imagined: one.tries.reduce((sum, { imagined }) => sum + imagined, 0),
  }));
  const most = Math.max(...racers.map((racer) => racer.tries.reduce((sum, one) => sum + Math.max(0, one.reward), 0)), 1);
  const n = Math.max(...racers.map((racer) => racer.tries.length));
  const note = make("p", { className: "small" }, "A try is a movement, paid by how different it is from all that the robot knows by then.");
  const again = (next, seed) => race(next, seed, row);
  const rows = racers.map((racer, k) => make("div", { className: `racer ${"ab"[k]}` }, [
    make("label", {}, [choice(k, groups, pair, (next) => again(next, seed))]), racer.score, make("div", { className: "bar" }, [racer.bar]),
  ]));
  const more = make("button", {}, "Again");
  more.addEventListener("click", () => again(pair, seed + 1));
  const skip = make("button", {}, "To the end");
  const row = make("span");
  const { player } = app;
  const before = { speed: player.speed, playing: player.playing };
  const place = make("div", { className: "stage" });
  const run = sheet("Two agents explore", [make("div", { className: "racers" }, rows), note], [row, skip, more], () => {
    player.speed = before.speed;
    if (!before.playing) player.pause();
    second?.remove();
    panel.stage?.setGhost(app.ghost);
    racers[0].words.remove();
    place.remove();
    document.body.classList.remove("racing");
    app.racing = false;
    show(app.points, { keep: false });
  });
  document.body.classList.add("racing");
  app.racing = true;
  $("stages").append(place);
  const second = panel.stage && new Stage(place, app.robot, player);
  panel.stage?.setGhost(false);
  [panel.place, place].forEach((host, k) => host.append(racers[k].words));
  skip.addEventListener("click", () => (run.fast = true));
  player.speed = RACE_SPEED;
  const marks = [];
  for (let turn = 0; turn < n && !run.over; turn++) {
    for (const dot of marks) dot[1] = dot[1].replace(" fresh", "");
    racers.map((racer, k) => [racer, k]).reverse().forEach(([racer, k]) => {
      const one = racer.tries[turn];
      if (!one) return;
      racer.total += one.reward;
      racer.score.textContent = racer.total.toFixed(1);
      racer.bar.style.width = `${(100 * Math.max(0, racer.total)) / most}%`;
      racer.words.textContent = `${racer.name}: ${CHIPS[one.outcome]}, +${one.reward.toFixed(2)}`;
      marks.push([one.pb, `${"ab"[k]} fresh`]);
      if (k) second?.show({ dt: panel.memory.dt, angles: panel.memory.recall([one.pb]).angles });
      else show([one.pb], { keep: false }); // starts both robots
    });
    player.touched = performance.now();
    panel.map.mark({ dots: marks });
    note.textContent = `Try ${turn + 1} of ${n}. A try is a movement, paid by how different it is from all that the robot knows by then.`;
    if (!run.fast) await new Promise((done) => setTimeout(done, turn < FIRST_TURNS ? SLOW_MS : FAST_MS));
  }
  if (run.over) return;
  skip.remove();
  player.speed = before.speed;
  note.textContent = [result(racers), ...racers.filter((racer) => racer.imagined).map((racer) =>
    `${racer.name} imagined ${racer.imagined} movements before performing ${racer.tries.length}.`),
  "That is what the benchmark measures, over many memories."].join(" ");
}

function result(racers) {
  const [best, other] = [...racers].sort((a, b) => b.total - a.total);
  const [high, low] = [best, other].map(({ total }) => total.toFixed(1));
  return high === low ? `Both earn ${high}.` : `${best.name} wins: ${high} against ${low}.`;
}
