// Key distribution: the error rate beside its limit, sifting, keys, and what an eavesdropper has.

import uPlot from "./uplot/uPlot.esm.js";
import { chart, colour } from "./charts.js";
import { count, element, table } from "./panels.js";

const MOST_POINTS = 1000; // those behind are thinned out
const OFTEN = 2; // wanted of a curve, at least: points
const IN_BOTH_BASES = new Set(["bb84", "bbm92", "e91"]); // bits of key are of Z and X, half of each
const PROTOCOLS = new Set([...IN_BOTH_BASES, "mdi"]);
const percent = (share, digits = 1) => (100 * share).toFixed(digits);
const STEPS = [["photons", "photons sent"], ["raw_bits", "detected by the receiver"], ["sifted_bits", "sifted: same basis at both ends"], ["key_bits", "secret key"]];

// Note what a program of key distribution reports.
export function note(state, m) {
  const qkd = state.qkd;
  if (m.event === "failed" && qkd.last) qkd.failed = { reason: m.reason, text: m.text };
  if (m.max_qber === undefined) return;
  const newest = m.newest_qber ?? (qkd.points.length || m.qber === null ? null : [m.qber, m.qber_low, m.qber_high]);
  const before = qkd.points.at(-1)?.error;
  const error = newest && String(newest) !== String(before) ? newest : null; // a key is drawn once
  qkd.last = m;
  // It is of the one session that the program has.
  const session = [...state.sessions.values()].find((each) => PROTOCOLS.has(each.asked.service));
  if (session && m.qber !== null) session.estimates.qber = { value: m.qber, low: m.qber_low, high: m.qber_high };
  qkd.points.push({ t: m.t, error: error ?? before, isNew: error !== null, sifted: m.sifted_bits, key: m.key_bits });
  if (qkd.points.length > MOST_POINTS) qkd.points = qkd.points.filter((each, number) => number % 2 || each.isNew).slice(-MOST_POINTS);
}

// Note that a host has measured photons that were not sent to it, or taken some: detail as events tell it.
export function intercepted(state, m) {
  const eve = state.eve[m.node] ?? { photons: 0, measured: 0, held: 0 };
  const sum = (pattern) => [...(m.detail ?? "").matchAll(pattern)].reduce((all, each) => all + Number(each[1]), 0);
  const measured = m.kind === "resend" ? sum(/[XYZ]=(\d+)/g) : 0, held = m.kind === "split" ? sum(/(?:\b2|more)=(\d+)/g) : 0;
  state.eve[m.node] = { photons: eve.photons + (m.photons ?? 0), measured: eve.measured + measured, held: eve.held + held };
}

// "15.2 % (13.8 to 16.8 %)"
function rate(value, low, high) {
  const digits = high - low > 0.1 ? 0 : high - low > 0.002 ? 1 : 2;
  return `${percent(value, Math.max(digits, 1))} % (${percent(low, digits)} to ${percent(high, digits)} %)`;
}

// The result in words, and whether that is good.
export function verdict({ last, failed }) {
  const qber = last.qber == null ? "" : `QBER ${rate(last.qber, last.qber_low, last.qber_high)}`;
  if (failed?.reason === "TOO_NOISY" && last.qber > last.max_qber) return [`No key: an eavesdropper or noise, ${qber}`, "failed"];
  if (failed) return [`No key: ${failed.text.replace(/^no key: /, "")}`, "failed"];
  const keys = `${count(last.key_bits)} bits of secret key`;
  if (last.event === "done") return [`Key made: ${keys}, ${qber}`, "good"];
  return [last.qber == null ? "Light is on its way; the error rate is known when test bits are compared" : `${keys} so far, ${qber}`, ""];
}

// The knowledge of eavesdroppers in words: at hosts, and on fibres.
export function eavesdroppers(state, fibers) {
  const services = new Set([...state.sessions.values()].map((each) => each.asked.service));
  const known = [...services].some((each) => IN_BOTH_BASES.has(each)) ? knowledge : () => "";
  const texts = Object.entries(state.eve).map(([name, { photons, measured, held }]) => {
    const share = measured / (photons || 1);
    if (held) return `${name} keeps a photon of ${count(held)} of ${count(photons)} pulses, and learns their bits when bases are announced.`;
    return `${name} has measured ${count(measured)} of ${count(photons)} photons (${percent(share)} %) and sent on the outcomes.${known(share)}`;
  });
  for (const { name, fraction } of fibers) texts.push(`Fibre ${name}: somebody measures ${percent(fraction)} % of the photons.${known(fraction)}`);
  return texts;
}

// Half of her bases are right; from the others half of the bits come out wrong.
const knowledge = (share) => ` She so knows ${percent(share / 2)} % of the sifted bits, and makes ${percent(share / 4)} % of them wrong.`;

export class Qkd {
  constructor(section) {
    this.section = section;
    this.at = (name) => section.querySelector(`.${name}`);
  }

  // The charts are made when they are first needed: their width is that of what is shown then.
  charts() {
    const percents = (_plot, values) => values.map((value) => `${value} %`);
    const errors = [["error rate of a key (%)", "--quantum"], ["95 % interval", "--quantum", 0.6], ["", "--quantum", 0.6], ["no key above this", "--bad"]];
    this.errors ??= chart(this.at("errors"), errors, (_plot, _least, most) => [0, 1.15 * (most || 1)], true,
      { bands: [{ series: [3, 2], fill: () => `color-mix(in srgb, ${colour("--quantum")} 20%, transparent)` }], values: percents, live: false });
    this.growth ??= chart(this.at("growth"), [["sifted bits", "--openflow"], ["secret key bits", "--quantum"]], (_plot, _least, most) => [0, 1.08 * (most || 1)], true, { live: false });
  }

  show(state, fibers) {
    const { qkd } = state, { last } = qkd, eve = eavesdroppers(state, fibers);
    this.section.hidden = !last && !eve.length;
    this.at("title").textContent = last ? "Key distribution" : "Eavesdroppers";
    if (this.section.hidden) return;
    this.at("eve").replaceChildren(...eve.map((text) => element("p", text)));
    this.at("verdict").hidden = this.at("gauge").hidden = !last;
    if (!last) return;
    const [text, kind] = verdict(qkd);
    if (this.at("verdict").textContent !== text) this.at("verdict").textContent = text;
    this.at("verdict").className = `verdict ${kind}`;
    gauge(this.at("gauge"), last);
    table(this.at("steps"), ["from photons to key", "", ""], STEPS.map(([name, words]) => [words, count(last[name]), bar(last[name] / (last.photons || 1))]), "");
    const { points } = qkd, keys = points.filter((each) => each.isNew);
    this.at("curves").hidden = keys.length < OFTEN;
    if (keys.length < OFTEN) return;
    this.charts();
    const column = (name) => points.map((each) => each[name]), limit = 100 * last.max_qber;
    const error = (place) => keys.map((each) => 100 * each.error[place]);
    this.errors.setData([keys.map((each) => each.t), error(0), error(1), error(2), keys.map(() => limit)]);
    this.growth.setData([column("t"), column("sifted"), column("key")]);
  }
}

function bar(share) {
  const cell = element("td", ""), made = element("span", "", "bar");
  made.style.width = `calc(${Math.min(share, 1)} * min(10rem, 9vw))`;
  cell.append(made);
  return cell;
}

// The error rate of all keys on a scale, its interval, and the limit above which there is none.
function gauge(at, { qber, qber_low, qber_high, max_qber }) {
  const most = Math.max(0.3, 1.1 * (qber_high ?? 0), 1.2 * max_qber), place = (share) => `${(100 * share) / most}%`;
  const mark = (kind, from, to, text) => {
    const made = element("span", text, kind);
    Object.assign(made.style, { left: place(from), width: to === from ? "" : place(to - from) });
    return made;
  };
  const marks = [mark("limit", max_qber, max_qber, `no key above ${percent(max_qber, 0)} %`)];
  if (qber != null) marks.push(mark("between", qber_low, qber_high, ""), mark("is", qber, qber, ""));
  at.setAttribute("aria-label", `error rate ${qber == null ? "not yet known" : `${percent(qber)} %`}; no key above ${percent(max_qber, 0)} %`);
  at.replaceChildren(...marks);
}
