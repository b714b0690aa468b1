// What the page shows by itself: a tour of surprises that a trained agent found, and two agents racing.
import { $, app, favourites, show, source, surprise, toast, waiting } from "./page.js";
import { sentence, stretches } from "./engine.js";
import { make } from "./drawing.js";

let stopped = () => {};

function sheet(title, children, next = []) {
  stopped();
  const box = $("stop");
  const close = make("button", { className: "quiet" }, "End");
  close.addEventListener("click", () => stopped());
  box.replaceChildren(make("h2", {}, title), ...children, make("div", { className: "row" }, [...next, make("span", { className: "gap" }), close]));
  box.hidden = false;
  const run = { over: false };
  stopped = () => {
    run.over = true;
    box.hidden = true;
    for (const one of app.panels) one.map.mark({ dots: (app.state.dots ?? []).map((pb) => [pb, ""]) });
    stopped = () => {};
  };
  return run;
}

const tries = (agent) => source.agent(agent, app.panels[0].name, 1);

// Four surprises: of what the agent earned most with, those that lie apart.
export async function tour() {
  const [best] = app.state.agents ?? [];
  const { memory } = app.panels[0];
  const played = best ? await waiting(() => tries(best), $("tour")) : null;
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
    const words = sentence(stretches(recall.angles, memory), memory);
    const last = place === found.length - 1;
    const next = make("button", { className: "primary" }, last ? "Explore yourself" : "Next");
    next.addEventListener("click", () => (last ? stopped() : step(place + 1)));
    sheet(`Surprise ${place + 1} of ${found.length}`, [
      make("p", {}, `The agent ${best} found this: nobody taught it. ${words} It earned ${reward.toFixed(1)} for being so different.`),
    ], [next]);
    next.focus();
  }
}

// Two agents explore before your eyes, try by try, and are paid for what is new.
export async function race() {
  const agents = app.state.agents ?? [];
  if (agents.length < 2) return toast("There are no agents here to watch.");
  const racers = [];
  for (const name of [agents[0], agents.at(-1)]) {
    const played = await waiting(() => tries(name), $("race"));
    if (!played) return;
    racers.push({ name, tries: played.tries, total: 0, bar: make("i"), score: make("b", { className: "figures" }, "0") });
  }
  const most = Math.max(...racers.map((racer) => racer.tries.reduce((sum, one) => sum + Math.max(0, one.reward), 0)), 1);
  const rows = racers.map((racer, k) => make("div", { className: `racer ${"ab"[k]}` }, [
    make("span", {}, `${k ? "Yellow" : "White"} dots: ${racer.name}`), racer.score, make("div", { className: "bar" }, [racer.bar]),
  ]));
  const note = make("p", { className: "small" }, "Each try is one movement. It is paid by how different it is from all that the robot knows by then.");
  const run = sheet("Two agents explore", [note, ...rows]);
  const dots = [];
  const speed = app.player.speed;
  app.player.speed = 3;
  for (let turn = 0; turn < racers[0].tries.length && !run.over; turn++) {
    for (const [k, racer] of racers.entries()) {
      const one = racer.tries[turn];
      if (!one || run.over) continue;
      racer.total += one.reward;
      racer.score.textContent = racer.total.toFixed(0);
      racer.bar.style.width = `${(100 * Math.max(0, racer.total)) / most}%`;
      for (const dot of dots) dot[1] = dot[1].replace(" fresh", "");
      dots.push([one.pb, `${"ab"[k]} fresh`]);
      app.panels[0].map.mark({ dots });
      show([one.pb], { keep: false });
      await new Promise((done) => setTimeout(done, turn < 4 ? 1400 : 450));
    }
  }
  app.player.speed = speed;
  if (run.over) return;
  const [a, b] = racers;
  note.textContent = `${a.total > b.total ? a.name : b.name} wins: ${Math.max(a.total, b.total).toFixed(0)} against ${Math.min(a.total, b.total).toFixed(0)}. That is what the benchmark measures, over many memories.`;
  favourites();
}
