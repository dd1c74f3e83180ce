// The page: messages come in, the state of one moment is shown, acts go out.

import * as acts from "./acts.js";
import { Charts } from "./charts.js";
import { ServerDrawing } from "./handshake.js";
import { Drawing } from "./network.js";
import { Networks } from "./networks.js";
import * as panels from "./panels.js";
import { Pictures } from "./pictures.js";
import { Qkd } from "./qkd.js";
import { Timeline } from "./timeline.js";
import { moment, reasons } from "./words.js";

const at = (id) => document.getElementById(id);
const network = await (await fetch("network.json")).json();
Object.assign(reasons, network.reasons);
const timeline = new Timeline(network.names);
const charts = new Charts(at("rates"), at("losses")), qkd = new Qkd(at("qkd"));
const view = { follow: true, playing: network.live, t: 0, chosen: null, ended: false, connected: false };
const networks = new Networks(network.number, at("networks"), view, () => status());
const drawing = new Drawing(at("network"), network, choose);
const SHORTEST_S = 3; // to play it all
const SETTLED_S = 1.5; // behind the last message: rates, which are of a second, are 0
const pictures = new Pictures(draw), drawings = [new ServerDrawing(at("handshake"), at("draw")), new ServerDrawing(at("photons"))];
let drawn = { count: -1, t: -1 }, state = timeline.state;

document.title = `${network.name} · qmn`;
at("name").textContent = network.number ? `network ${network.number}: ${network.name}` : network.name;
choose(null);

function choose(chosen) {
  view.chosen = chosen;
  acts.show(at("chosen"), chosen, network, state ?? timeline.state, perform, () => choose(null));
  drawn.t = -1;
  pictures.numbers = -Infinity; // what one has done oneself is seen at once
  pictures.wake();
}

async function perform(fields) {
  try {
    const answer = await fetch("act", {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(fields),
    });
    if (answer.ok || answer.status === 400) return await answer.json();
    return { output: `${answer.status} ${answer.statusText}`, status: 1 };
  } catch (error) {
    return { output: `the view does not answer (${error.message}): has the network ended?`, status: 1 };
  }
}

function listen() {
  const source = new EventSource("messages");
  source.addEventListener("open", () => { view.connected = true; status(); });
  source.addEventListener("messages", (event) => {
    timeline.add(JSON.parse(event.data));
    pictures.wake();
  });
  source.addEventListener("pause", (event) => { pictures.pause = Number(event.data); status(); });
  source.addEventListener("missed", (event) => { timeline.missed += Number(event.data); });
  source.addEventListener("ended", () => { view.ended = true; source.close(); pace(); status(); });
  source.addEventListener("error", () => { view.connected = false; status(); });
}

// A run that is over plays in some seconds, however short it was.
function pace() {
  const speeds = [...at("speed").options].map((each) => Number(each.value)).reverse();
  at("speed").value = String(speeds.find((each) => timeline.end / each >= SHORTEST_S) ?? speeds.at(-1));
}

function status() {
  const words = !network.live ? network.over
    : view.ended || view.connected ? networks.describe(view.follow ? "live" : "live, looking back")
    : "no connection: has the network ended?";
  const missed = timeline.missed + timeline.state.missed;
  const seldom = pictures.seldom && view.connected && !view.ended
    ? "; drawn once a second, as the computer is busy" : "";
  const text = `${words}${seldom}${missed ? `; ${panels.count(missed)} earlier messages are not shown` : ""}`;
  if (at("status").textContent !== text) at("status").textContent = text;
  const label = view.playing ? "pause" : "play";
  if (at("play").textContent !== label) at("play").textContent = label;
}

function draw(passed, numbers) {
  if (view.follow) view.t = timeline.end;
  else if (view.playing) {
    view.t = Math.min(view.t + (passed / 1000) * Number(at("speed").value), timeline.end);
    if (view.t >= timeline.end && (!network.live || view.ended)) view.playing = false, status();
  }
  const now = performance.now(), count = timeline.messages.length + timeline.missed;
  if (view.t !== drawn.t || (view.follow && count !== drawn.count)) {
    state = view.follow ? timeline.state : timeline.at(view.t);
    at("clock").value = moment(view.t);
    drawn = { t: view.t, count, at: now, stale: true };
  }
  // Between messages time goes on: photons that were seen pass, and none come any more.
  const goes = view.follow && network.live && !view.ended, since = goes ? (now - drawn.at) / 1000 : 0;
  const moves = drawing.show({ ...state, t: state.t + since }, view.chosen, now, numbers);
  if (numbers) stretch();
  if (numbers && drawn.stale) tables();
  if (!view.follow && view.playing) pictures.wake();
  return moves || (goes && since < SETTLED_S);
}

// All time that has come can be gone to, also what came while the page is paused.
function stretch() {
  const slider = at("slider");
  slider.min = timeline.begin;
  slider.max = Math.max(timeline.end, timeline.begin + 1e-6);
  slider.value = view.t;
}

function tables() {
  drawn.stale = false;
  panels.sessions(at("sessions"), state);
  panels.outcomes(at("outcomes"), state);
  panels.memories(at("memories"), state);
  panels.keys(at("keys"), state);
  panels.job(at("job"), state);
  panels.decisions(at("decisions"), state);
  charts.show(state);
  qkd.show(state, drawing.tapped(state));
  if (view.chosen) acts.refresh(at("chosen"), view.chosen, state);
  else panels.paths(at("paths"), drawing.paths(state));
  for (const each of drawings) each.changed(state, pictures.seldom);
  status();
}

for (const name of ["focus", "pointerdown"]) at("slider").addEventListener(name, stretch);
at("slider").addEventListener("input", (event) => {
  Object.assign(view, { follow: false, playing: false, t: Number(event.target.value) });
  status();
  pictures.wake();
});
at("play").addEventListener("click", () => {
  if (!view.playing && view.t >= timeline.end && !(network.live && !view.ended)) view.t = timeline.begin;
  Object.assign(view, { playing: !view.playing, follow: false });
  status();
  pictures.begin();
});
at("now").addEventListener("click", () => {
  Object.assign(view, { follow: true, playing: network.live && !view.ended });
  status();
  pictures.wake();
});
at("nearer").addEventListener("click", () => drawing.zoom(1 / 1.3));
at("farther").addEventListener("click", () => drawing.zoom(1.3));
at("whole").addEventListener("click", () => drawing.fit());
addEventListener("keydown", (event) => { if (event.key === "Escape" && view.chosen) choose(null); });

listen();
pictures.wake();
