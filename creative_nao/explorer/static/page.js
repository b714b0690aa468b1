// The explorer's page: what is shown where, what keys and buttons do, and where the tab stands.
import { Cells, Memory, letter, colourOf, sentence, stretches } from "./engine.js";
import { PBMap, WHOLE, following, legend, rampCss, zoomed } from "./map.js";
import { Player, Stage } from "./robot.js";
import { Alone, Served, base64Blob, download } from "./source.js";
import { curvesSvg, fill, make } from "./drawing.js";
import { race, runDots, tour } from "./shows.js";

export const $ = (id) => document.getElementById(id);
const embedded = $("data");
export const source = embedded ? new Alone(JSON.parse(embedded.textContent)) : new Served();
const kept = {
  get: (name) => { try { return localStorage.getItem(`creative-nao-${name}`); } catch { return null; } },
  set: (name, value) => { try { localStorage.setItem(`creative-nao-${name}`, value); } catch { /* a file may have no store */ } },
};
const nameOf = (outcome) => `chip ${outcome}`;

export const app = {
  panels: [], points: [[0, 0]], past: [], future: [], view: WHOLE, colour: "nearest", drawing: null, favourites: [], racing: false,
  physics: kept.get("physics") === "yes", ghost: kept.get("ghost") !== "no", player: null, robot: null, state: null,
};
globalThis.explorer = app; // for tests and benchmarks

// One memory: its map, its robot and its movement.
class Panel {
  constructor(name, page) {
    Object.assign(this, { name, key: page.key, colours: page.colours, fine: page.fine, agents: page.agents, dots: page.dots, page, finer: null, body: null });
    this.memory = new Memory(page.memory);
  }

  async build() {
    this.cells = await Cells.from(this.page.cells);
    this.page = null;
    this.host = make("div", { className: "map", tabIndex: 0, id: app.panels.length ? "map2" : "map" }, [
      make("canvas"), marksLayer(), make("span", { className: "of" }, this.memory.name),
    ]);
    this.host.setAttribute("role", "application");
    this.host.setAttribute("aria-label", `Map of memory ${this.memory.name}: every point is a movement. Arrow keys move.`);
    $("maps").append(this.host);
    this.place = make("div", { className: "stage" });
    this.place.setAttribute("role", "img");
    this.place.setAttribute("aria-label", `The robot performing the movement of memory ${this.memory.name}`);
    $("stages").append(this.place);
    this.words = make("p", { className: "verdict" }, [make("span", { className: "chip" }), make("span")]);
    $("verdicts").append(this.words);
    try {
      this.stage = new Stage(this.place, app.robot, app.player);
      this.stage.setGhost(app.ghost);
    } catch {
      this.place.append(make("p", { className: "no-webgl" }, "The robot needs WebGL. Without it, the sentence and the curves still tell all."));
    }
    this.map = new PBMap(this.host, this.memory, {
      press: (pb) => press(pb), drag: (pb) => drag(pb), release: () => release(), zoom: (factor, pb) => zoom(factor, pb),
      hover: (pb, event) => card(this, pb, event), hold: (pb, event) => card(this, pb, event),
    });
    this.map.show(this.cells, null, app.colour, app.view);
    return this;
  }

  remove() {
    for (const part of [this.host, this.place, this.words]) part.remove();
    this.stage?.remove();
  }

  present(recall, anew) {
    Object.assign(this, { recall, body: null });
    const { dt, demonstrations } = this.memory;
    this.stage?.show({ dt, angles: recall.angles }, { dt, angles: demonstrations[recall.nearest] });
    this.map.mark({ points: app.points }, anew);
    this.say();
  }

  say() {
    const told = this.memory.describe(this.recall, this.body);
    const [chip, text] = this.words.children;
    chip.className = nameOf(told.kind);
    chip.textContent = told.chip;
    text.textContent = told.text;
    return `${told.chip}. ${told.text}`;
  }

  async perform() {
    const recall = this.recall;
    const clip = await waiting(() => source.perform(this.memory.dt, recall.angles));
    if (!clip || recall !== this.recall || !app.physics) return;
    this.body = clip;
    this.stage?.show(clip, null);
    app.player.start(true);
    this.say();
    settle();
  }
}

function marksLayer() {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 100 100");
  svg.innerHTML = '<g></g><g class="ring"><circle r="2"/><circle r="2"/></g>';
  return svg;
}

// ---- the movement shown

export function show(points, { keep = true, anew = true } = {}) {
  if (keep) {
    app.past = [...app.past, app.points].slice(-500);
    app.future = [];
  }
  app.points = points.map((pb) => pb.map((value) => Math.min(1, Math.max(-1, value))));
  for (const panel of app.panels) panel.present(panel.memory.recall(app.points), anew);
  app.player.start(anew);
  if (anew) perform();
  $("hint")?.remove();
  settle(keep);
}

const still = matchMedia("(prefers-reduced-motion: reduce)");

// A movement that is chosen plays, also while the player is paused or at its end; where nothing may move by itself, the
// robot stands in the posture that tells it best: all movements begin in the same one.
function perform() {
  const { player } = app;
  if (!still.matches) return player.playing || player.play();
  const { memory, recall } = app.panels[0];
  if (!player.playing) player.seek(memory.dt * recall.angles.indexOf(telling(recall.angles)));
}

let settling = 0;
let pushes = false;
function settle(push = false) {
  clearTimeout(settling);
  pushes ||= push;
  settling = setTimeout(() => {
    $("status").textContent = app.panels.map((panel) => panel.say()).join(" ");
    const address = addressOf();
    if (pushes && address !== location.search) history.pushState(null, "", address);
    else if (source.served) history.replaceState(null, "", address);
    pushes = false;
    follow();
    details();
    buttons();
    if (app.physics && source.served && !app.racing) for (const panel of app.panels) if (!panel.body) panel.perform();
  }, 160);
}

function buttons() {
  $("undo").disabled = !app.past.length;
  $("redo").disabled = !app.future.length;
}

function addressOf() {
  if (!source.served) return "#";
  const number = (value) => Number(value.toPrecision(6));
  const query = new URLSearchParams();
  if (app.points.length > 1) query.set("path", app.points.map((pb) => pb.map(number).join(",")).join("_"));
  else ["x", "y"].forEach((name, k) => query.set(name, number(app.points[0][k])));
  if (app.panels[1]) query.set("beside", app.panels[1].name);
  if (app.view !== WHOLE) query.set("view", ["left", "bottom", "width"].map((side) => Number(app.view[side].toPrecision(7))).join(","));
  if (app.colour !== "nearest") query.set("colour", app.colour);
  if (app.taught) query.set("taught", app.taught);
  return `?${query.toString().replaceAll("%2C", ",").replaceAll("%2F", "/")}`;
}

function fromAddress() {
  const query = new URLSearchParams(location.search);
  const finite = (text) => (Number.isFinite(Number(text)) ? Math.min(1, Math.max(-1, Number(text))) : 0);
  const path = (query.get("path") ?? "").split("_").map((pair) => pair.split(",")).filter((pair) => pair.length === 2).slice(0, 200);
  const one = query.has("x") || query.has("y") ? [[finite(query.get("x")), finite(query.get("y"))]] : null;
  const [left, bottom, width] = (query.get("view") ?? "").split(",").map(Number);
  const isView = [left, bottom, width].every(Number.isFinite) && width >= 0.002 && width < 2;
  const inside = (low) => Math.min(Math.max(low, -1), 1 - width);
  return {
    points: path.length ? path.map((pair) => pair.map(finite)) : one, beside: query.get("beside") ?? "",
    view: isView ? { left: inside(left), bottom: inside(bottom), width } : WHOLE,
    colour: query.get("colour") ?? "nearest", taught: query.get("taught") ?? "",
  };
}

function undo(from, to) {
  if (!app[from].length) return;
  app[to].push(app.points);
  show(app[from].pop(), { keep: false });
}

// ---- pointer on the map

let pending = null;
function press(pb) {
  hideCard();
  if (app.drawing) return void (app.drawing = [pb]);
  show([pb]);
}

function drag(pb) {
  if (!pending) requestAnimationFrame(dragged);
  pending = pb;
}

function dragged() {
  const pb = pending;
  pending = null;
  if (!app.drawing) return show([pb], { keep: false, anew: false });
  if (app.drawing.length < 200) app.drawing.push(pb);
  for (const panel of app.panels) panel.map.mark({ points: app.drawing });
}

function release() {
  if (!app.drawing?.length) return;
  const drawn = app.drawing;
  setDrawing(false);
  show(drawn);
}

function setDrawing(on) {
  app.drawing = on ? [] : null;
  $("draw").setAttribute("aria-pressed", on);
}

let carded = 0;
let small = null;
function hideCard() {
  cancelAnimationFrame(carded);
  $("card").hidden = true;
  small?.player.pause();
}

function card(panel, pb, event) {
  cancelAnimationFrame(carded);
  if (!pb || app.drawing) return hideCard();
  carded = requestAnimationFrame(() => {
    const recall = panel.memory.recall([pb]);
    const told = panel.memory.describe(recall);
    const box = $("card");
    box.hidden = false;
    const left = event.clientX + 320 > innerWidth ? event.clientX - 320 : event.clientX + 20;
    box.style.left = `${Math.max(4, left)}px`;
    box.style.top = `${Math.min(innerHeight - 130, Math.max(4, event.clientY + (event.pointerType === "touch" ? -140 : 16)))}px`;
    $("card-chip").className = nameOf(told.kind);
    $("card-chip").textContent = told.chip;
    $("card-like").textContent = `most like ${panel.memory.names[recall.nearest]}`;
    $("card-novelty").style.left = `${100 * panel.memory.share(recall.novelty)}%`;
    if (!small && panel.stage) {
      const player = new Player();
      small = { player, stage: new Stage($("card-stage"), app.robot, player, true) };
    }
    if (!small) return;
    const anew = !small.player.playing;
    small.stage.show({ dt: panel.memory.dt, angles: recall.angles });
    small.player.start(anew);
    if (anew) small.player.play();
  });
}

let painter = null;
export function pictureOf(angles) {
  if (!app.panels[0]?.stage) return null;
  painter ??= new Stage(make("div"), app.robot, null, true);
  return painter.picture(angles, 168, 120);
}

// The posture that tells a movement best: the one farthest from where it begins.
export function telling(angles) {
  const far = angles.map((row) => row.reduce((sum, angle, k) => sum + (angle - angles[0][k]) ** 2, 0));
  return angles[far.indexOf(Math.max(...far))];
}

// ---- maps: window and colours

function zoom(factor, around) {
  const seen = app.points.at(-1);
  const { left, bottom, width } = app.view;
  const inside = seen[0] >= left && seen[0] <= left + width && seen[1] >= bottom && seen[1] <= bottom + width;
  look(zoomed(app.view, factor, around ?? (inside ? seen : [left + width / 2, bottom + width / 2])));
}

function follow() {
  if (app.view === WHOLE || app.points.length > 1) return;
  const moved = following(app.view, app.points[0]);
  if (moved !== app.view) look(moved);
}

let looking = null;
export async function look(view, colour = app.colour) {
  looking?.abort();
  const control = (looking = new AbortController());
  Object.assign(app, { view, colour });
  $("whole").disabled = view === WHOLE;
  $("colour").value = colour;
  const nearer = 2 / view.width;
  $("zoomed").textContent = view === WHOLE ? "the whole map" : `${nearer < 10 ? nearer.toFixed(1) : nearer.toFixed(0)} times nearer`;
  paint();
  settle();
  const special = colour.startsWith("physical");
  for (const panel of app.panels) {
    const name = panel.name;
    if (!panel.cells.values[colour] && !["nearest", "outcome"].includes(colour)) {
      await working(panel, async () => {
        const cells = await Cells.from(await source.cells(name, colour, null, null, control.signal));
        if (special) panel.special = cells;
        else Object.assign(panel.cells.values, cells.n === panel.cells.n ? cells.values : {});
      });
      if (control.signal.aborted) return;
      paint();
    }
    if (view === WHOLE || special || !source.served) continue;
    await new Promise((done) => setTimeout(done, 150));
    for (const n of [50, 200]) {
      if (control.signal.aborted) return;
      if (n * 2 <= panel.cells.n * view.width) continue; // the map's own cells are finer here
      await working(panel, async () => {
        const cells = await source.cells(name, colour, view, n, control.signal);
        panel.finer = { colour, cells: await Cells.from(cells) };
      });
      if (control.signal.aborted) return;
      paint();
    }
  }
}

function shownCells(panel) {
  if (app.colour.startsWith("physical")) return panel.special?.values[app.colour] || app.colour === "physical" ? panel.special ?? panel.cells : panel.cells;
  const { finer } = panel;
  const fits = finer?.cells.covers(app.view) && app.view !== WHOLE && (!panel.cells.values[app.colour] || finer.cells.values[app.colour]);
  return fits ? finer.cells : panel.cells;
}

function paint() {
  const whole = app.panels.map((panel) => (app.colour.startsWith("physical") ? shownCells(panel) : panel.cells).values[app.colour]).filter(Boolean);
  const span = whole.length ? [Math.min(...whole.map((one) => one.low)), Math.max(...whole.map((one) => one.high))] : null;
  for (const panel of app.panels) panel.map.show(shownCells(panel), span, app.colour, app.view);
  const first = app.panels[0];
  const entries = legend(first.memory, app.colour.startsWith("physical") ? shownCells(first) : first.cells, app.colour).map(([background, words]) => {
    const swatch = make("i");
    swatch.style.background = background;
    return make("span", {}, [swatch, words]);
  });
  if (span) {
    const scale = make("i", { className: "ramp" });
    scale.style.background = rampCss();
    const figure = (value) => Number(value.toPrecision(3));
    entries.unshift(make("span", {}, [`${first.colours[app.colour]}: ${figure(span[0])} `, scale, ` ${figure(span[1])}`]));
  }
  $("legend").replaceChildren(...entries);
}

async function working(panel, job) {
  const sign = make("span", { className: "working" }, [make("i", { className: "spinner" })]);
  panel.host.append(sign);
  try {
    await job();
  } catch (error) {
    if (error.name !== "AbortError") toast(error.message);
  } finally {
    sign.remove();
  }
}

async function refine() {
  while (app.panels.some((panel) => !panel.fine)) {
    await new Promise((done) => setTimeout(done, 1500));
    for (const panel of app.panels.filter((one) => !one.fine)) {
      const page = await source.memory(panel.name).catch(() => ({}));
      if (!page.fine) continue;
      panel.fine = true;
      panel.cells = await Cells.from(page.cells);
      look(app.view);
    }
  }
}

// ---- details

function details() {
  if ($("drawer").hidden) return;
  const { memory, recall } = app.panels[0];
  const last = app.points.at(-1);
  ["pb1", "pb2"].forEach((id, k) => {
    if (document.activeElement !== $(id)) $(id).value = last[k].toFixed(app.panels[0].map.digits);
  });
  const figures = app.panels.map((panel) => `${panel.memory.name}: ${panel.recall.novelty.toFixed(1)} rad from ${panel.memory.names[panel.recall.nearest]}, the nearest taught movement`);
  $("numbers").textContent = `${figures.join("; ")}. Up to ${memory.learnedThreshold} counts as taught (differences of posture, summed over time: DTW).`;
  $("curves").innerHTML = curvesSvg(memory, recall);
  const parts = stretches(recall.angles, memory);
  const end = Math.max(1, recall.angles.length - 1);
  const share = (tick) => (100 * Math.min(Math.max(tick - 0.5, 0), end)) / end;
  const blocks = parts.map(({ first, end: until, action, distances }) => {
    const width = (until === recall.angles.length ? 100 : share(until)) - share(first);
    const block = make("b", {}, width >= 5 ? letter(action) : "");
    const strength = 0.25 + 0.75 * 2 ** (-distances.reduce((a, b) => a + b) / distances.length / 0.2);
    block.style.cssText = `left:${share(first)}%;width:${width}%`;
    block.style.background = `color-mix(in srgb, ${colourOf(action)} ${(100 * strength).toFixed(0)}%, #f5f5f5)`;
    return block;
  });
  $("strip").replaceChildren(...blocks, make("i", { id: "strip-cursor" }));
  $("resembles").textContent = sentence(parts, memory);
  ticked();
}

function drawer(open) {
  $("drawer").hidden = !open;
  $("open-drawer").setAttribute("aria-expanded", open);
  document.body.classList.toggle("detailed", open);
  if (open) details();
}

// ---- favourites

const channel = "BroadcastChannel" in globalThis ? new BroadcastChannel("creative-nao") : null;
channel?.addEventListener("message", () => favourites());

export async function favourites() {
  const first = app.panels[0];
  if (!first) return;
  app.favourites = await source.favourites(first.key).catch(() => app.favourites);
  const items = app.favourites.slice(-24).map((favourite) => {
    const recall = first.memory.recall(favourite.points);
    const words = favourite.note || `${first.memory.describe(recall).chip}, most like ${first.memory.names[recall.nearest]}`;
    const picture = pictureOf(telling(recall.angles));
    const open = make("button", { title: words, ariaLabel: `Favourite: ${words}` }, picture ? [make("img", { src: picture, alt: "" })] : letter(recall.nearest));
    open.addEventListener("click", async () => {
      show(favourite.points);
      if (favourite.beside && favourite.beside !== app.panels[1]?.name) await setBeside(favourite.beside);
    });
    const remove = make("button", { className: "remove", ariaLabel: "Remove this favourite" }, "✕");
    remove.addEventListener("click", async () => {
      if ((await changed(() => source.forget(favourite))) && !$("toasts").childElementCount) toast("Removed.", ["Undo", () => changed(() => source.keep(favourite))]);
    });
    const item = make("div", { className: "favourite" }, [open, remove]);
    item.setAttribute("role", "listitem");
    return item;
  });
  $("favourites").replaceChildren(...(items.length ? items : [make("span", { className: "small", role: "listitem" }, "Keep what you like with the star.")]));
  first.map.mark({ stars: app.favourites.map(({ points }) => points.at(-1)) });
}

async function changed(change) {
  try {
    await change();
  } catch (error) {
    toast(`The favourites stay as they were: ${error.message}`);
    return false;
  }
  channel?.postMessage("favourites");
  await favourites();
  return true;
}

const keepFavourite = () => changed(() => source.keep({
  memory: app.panels[0].key, points: app.points, note: "", beside: app.panels[1]?.name ?? "",
}));

// ---- small parts

export function toast(text, action = null) {
  const box = make("div", { className: "toast" }, text);
  if (action) {
    const button = make("button", {}, action[0]);
    button.addEventListener("click", () => {
      box.remove();
      action[1]();
    });
    box.append(" ", button);
  }
  $("toasts").append(box);
  setTimeout(() => box.remove(), 8000 + 50 * text.length);
}

export async function waiting(job, button = null) {
  const sign = make("span", { className: "working" }, [make("i", { className: "spinner" })]);
  (button ?? $("scene")).append(sign);
  try {
    return await job();
  } catch (error) {
    toast(error.message);
    return null;
  } finally {
    sign.remove();
  }
}

let lastHit = 0;
function ticked() {
  const { player } = app;
  const share = player.duration ? player.time / player.duration : 0;
  fill($("play"), { className: player.playing ? "icon playing" : "icon", ariaLabel: player.playing ? "Pause" : "Play" });
  if (document.activeElement !== $("scrub") || player.playing) $("scrub").value = Math.round(1000 * share);
  $("clock").textContent = `${player.time.toFixed(1)} s`;
  if (!$("drawer").hidden && $("strip-cursor")) {
    $("strip-cursor").style.left = `${100 * share}%`;
    for (const line of document.querySelectorAll(".cursor")) line.setAttribute("transform", `translate(${150 * share} 0)`);
  }
  const body = app.panels[0]?.body;
  if (body) {
    const hit = body.hits.find(([time]) => time > lastHit && time <= player.time);
    if (hit) flash(`${hit[1].toFixed(0)} N`);
    if (body.fell !== null && lastHit < body.fell && player.time >= body.fell) flash("falls");
  }
  lastHit = player.time;
}

function flash(text) {
  $("badge").textContent = text;
  $("badge").classList.remove("hit");
  requestAnimationFrame(() => $("badge").classList.add("hit"));
  app.panels[0].stage?.flash();
}

export async function setBeside(name) {
  if (app.panels[1]) app.panels.pop().remove();
  if (name && name !== app.panels[0].name) {
    await waiting(async () => {
      const panel = await new Panel(name, await source.memory(name)).build();
      app.panels.push(panel);
    });
  }
  document.body.classList.toggle("twin", app.panels.length > 1);
  $("beside").value = app.panels[1]?.name ?? "";
  show(app.points, { keep: false });
  look(app.view);
  refine();
}

function jump(cells, how, none) {
  const pb = cells[how](app.points.at(-1));
  if (pb) show([pb]);
  else toast(none);
}
export const surprise = () => jump(app.panels[0].cells, "surprise", "Everything usable on this map was taught: teach it more, or train it longer, to be surprised.");

async function receive(file) {
  const panel = app.panels[0];
  const read = await waiting(() => source.read(panel.name, file), null);
  if (!read) return;
  const [first, ...others] = read.movements;
  const recall = { points: [read.pb], ...panel.memory.evaluate(first.angles) };
  app.past.push(app.points);
  app.points = [read.pb];
  panel.present(recall, true);
  panel.map.mark({ letters: { R: read.pb } });
  app.player.start(true);
  settle(false);
  const several = others.length ? [`it holds ${others.length + 1} movements, this is the first`] : [];
  const notes = [...several, ...first.notes].map((note) => `; ${note}`).join("");
  toast(`${file.name}: the memory comes nearest at R, ${read.error.toFixed(1)} rad away${notes}.`);
}

function key(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
  const tag = event.target.tagName;
  if (/^(INPUT|SELECT|TEXTAREA)$/.test(tag) || (tag === "BUTTON" && /^( |Enter)$/.test(event.key))) return;
  const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
  const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const step = (app.view.width / 200) * (event.shiftKey ? 10 : 1);
  const basic = app.panels[0].memory.pb[Number(event.key) - 1];
  const does = {
    " ": () => app.player.toggle(), r: surprise, m: () => $("more").click(), l: () => $("less").click(), s: keepFavourite,
    u: () => (event.shiftKey ? undo("future", "past") : undo("past", "future")), d: () => drawer($("drawer").hidden),
    "+": () => zoom(2), "=": () => zoom(2), "-": () => zoom(0.5), 0: () => look(WHOLE), "?": () => $("keys").showModal(),
    Escape: () => drawer(false),
  }[name];
  if (arrow) show([app.points.at(-1).map((value, k) => value + step * arrow[k])], { keep: false });
  else if (basic) show([basic]);
  else if (does) does();
  else return;
  event.preventDefault();
}

function press_toggle(id, name, then) {
  $(id).setAttribute("aria-pressed", app[name]);
  $(id).addEventListener("click", () => {
    app[name] = !app[name];
    kept.set(name, app[name] ? "yes" : "no");
    $(id).setAttribute("aria-pressed", app[name]);
    then();
  });
}

const on = (id, act, kind = "click") => $(id).addEventListener(kind, act);

// What every page has: the player's bar, dark or light, and files that are dropped.
export function controls(receive) {
  on("play", () => app.player.toggle());
  on("scrub", () => {
    app.player.pause();
    app.player.seek(($("scrub").value / 1000) * app.player.duration);
  }, "input");
  on("loop", () => {
    app.player.looping = !app.player.looping;
    $("loop").setAttribute("aria-pressed", app.player.looping);
  });
  on("speed", () => {
    app.player.speed = { 1: 0.5, 0.5: 0.25, 0.25: 1 }[app.player.speed];
    fill($("speed"), { textContent: `${{ 1: "1", 0.5: "½", 0.25: "¼" }[app.player.speed]}×`, ariaLabel: `Speed ${app.player.speed}` });
  });
  on("camera", () => app.panels.forEach((panel) => panel.stage?.home()));
  on("full", () => (document.fullscreenElement ? document.exitFullscreen() : $("scene").requestFullscreen()));
  on("dark", () => kept.set("dark", document.documentElement.classList.toggle("dark") ? "yes" : "no"));
  document.addEventListener("dragover", (event) => event.preventDefault());
  document.addEventListener("drop", (event) => {
    event.preventDefault();
    const [file] = event.dataTransfer.files;
    if (file && source.served) receive(file);
  });
}

function listen() {
  on("surprise", surprise);
  on("more", () => jump(app.panels[0].cells, "moreLike", "Nothing usable is near."));
  on("less", () => jump(app.panels[0].cells, "lessLike", "Nothing usable is far away."));
  on("undo", () => undo("past", "future"));
  on("redo", () => undo("future", "past"));
  on("star", keepFavourite);
  on("draw", () => setDrawing(!app.drawing));
  on("whole", () => look(WHOLE));
  on("zoom-in", () => zoom(2));
  on("zoom-out", () => zoom(0.5));
  on("colour", () => look(app.view, $("colour").value), "change");
  on("open-drawer", () => drawer($("drawer").hidden));
  on("close-drawer", () => drawer(false));
  on("shortcuts", () => $("keys").showModal());
  controls(receive);
  press_toggle("physics", "physics", () => show(app.points, { keep: false }));
  press_toggle("ghost", "ghost", () => app.panels.forEach((panel) => panel.stage?.setGhost(app.ghost)));
  on("place", (event) => {
    event.preventDefault();
    const values = ["pb1", "pb2"].map((id) => Number($(id).value.replace(",", ".")));
    if (values.every(Number.isFinite)) show([values]);
    else toast("PB 1 and PB 2 are numbers from -1 to 1.");
  }, "submit");
  on("walk", () => show(["walk-from", "walk-to"].map((id) => app.panels[0].memory.pb[Number($(id).value)])));
  on("beside", () => setBeside($("beside").value), "change");
  on("tour", () => tour());
  on("race", () => race());
  on("export", async () => {
    const format = $("format").value;
    const { memory, recall, name } = app.panels[0];
    const movement = { dt: memory.dt, angles: recall.angles.map((row) => [...row]), ending: format, physics: app.physics };
    const made = await waiting(() => (["gif", "mp4"].includes(format) ? source.film(movement) : source.export(name, app.points, format)), $("export"));
    if (!made) return;
    made.changes?.forEach((change) => toast(change));
    download(made.name, base64Blob(made));
  });
  on("import", () => {
    const [file] = $("import").files;
    $("import").value = "";
    if (file) receive(file);
  }, "change");
  document.addEventListener("keydown", key);
  addEventListener("popstate", () => {
    const place = fromAddress();
    if (place.points) show(place.points, { keep: false });
    look(place.view, place.colour);
  });
  addEventListener("focus", () => favourites());
}

function options(id, pairs) {
  $(id).replaceChildren(...pairs.map(([value, text]) => new Option(text, value)));
}

// The walk between two taught movements that stays usable, if there is one.
function goodWalk({ memory }) {
  for (let a = 0; a < memory.pb.length; a++) {
    for (let b = a + 1; b < memory.pb.length; b++) {
      if (memory.recall([memory.pb[a], memory.pb[b]]).outcome === "unlearned") return [a, b];
    }
  }
  return [0, memory.pb.length - 1];
}

async function start() {
  const asked = kept.get("dark");
  const dark = asked ? asked === "yes" : matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.classList.toggle("dark", dark);
  document.body.classList.toggle("static", !source.served);
  const since = Date.now();
  for (;;) {
    app.state = await source.state();
    if (app.state.ready) break;
    const seconds = Math.round((Date.now() - since) / 1000);
    $("wait-text").textContent = `Waking the robot ... ${seconds} s. The very first time it compiles for about a minute.`;
    await new Promise((done) => setTimeout(done, 400));
  }
  app.robot = await source.robot();
  app.player = new Player(ticked);
  if (location.pathname.endsWith("/teach")) {
    const { teach } = await import("./teach.js");
    await teach();
    document.body.classList.remove("loading");
    return;
  }
  const place = fromAddress();
  let name = place.taught ? `taught:${place.taught}` : app.state.first;
  let page = await source.memory(name).catch((error) => {
    toast(`${error.message} This is the server's own memory instead.`);
    return null;
  });
  if (!page) page = await source.memory((name = app.state.first));
  else app.taught = place.taught;
  app.panels.push(await new Panel(name, page).build());
  const [first] = app.panels;
  $("name").textContent = first.memory.name;
  document.title = `${first.memory.name}: memory explorer`;
  options("colour", Object.entries(first.colours));
  options("beside", [["", "none"], ...app.state.names.filter((one) => one !== first.name).map((one) => [one, one])]);
  options("format", [...(app.state.formats ?? []).map(([ending, text]) => [ending, text.replaceAll("`", "")]), ["gif", "GIF: film"], ["mp4", "MP4: film"]]);
  for (const id of ["walk-from", "walk-to"]) options(id, first.memory.names.map((text, k) => [k, `${letter(k)} ${text}`]));
  goodWalk(first).forEach((place, k) => ($(["walk-from", "walk-to"][k]).value = place));
  if (source.served && app.taught) $("to-teach").href = `teach?taught=${app.taught}`;
  listen();
  if (!kept.get("touched") && !place.points) {
    first.host.append(make("div", { className: "hint", id: "hint" }, "Every point is a movement. Drag to explore."));
    first.host.addEventListener("pointerdown", () => kept.set("touched", "yes"), { once: true });
  }
  first.map.mark({ dots: runDots() });
  const hint = $("hint");
  app.points = place.points ?? [first.cells.surprise() ?? first.memory.pb[0]];
  show(app.points, { keep: false });
  if (hint) first.host.append(hint);
  const colour = place.colour in first.colours ? place.colour : "nearest";
  if (place.colour !== colour) toast(`There are no colours “${place.colour.slice(0, 40)}” here.`);
  look(place.view, colour);
  const beside = place.beside || app.state.beside;
  document.body.classList.remove("loading");
  if (beside && source.served) {
    if (!app.state.names.includes(beside)) toast(`There is no memory “${beside.slice(0, 40)}” to show beside.`);
    else if (beside !== name) await setBeside(beside);
  }
  await favourites();
  if (source.served) refine();
  if (app.taught) setInterval(() => source.ask(`taught/${app.taught}`).catch((error) => toast(error.message)), 10_000);
}

start().catch((error) => {
  $("wait-text").textContent = `The page cannot start: ${error.message}`;
  throw error;
});
