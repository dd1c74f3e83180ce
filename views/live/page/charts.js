// Rates and losses over time, by uPlot.

import uPlot from "./uplot/uPlot.esm.js";
import { BUCKET_S, unknownSince, WINDOW_S } from "./light.js";

const MOST_POINTS = 400, MANY = 20, HEIGHT = 170;
export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Charts {
  constructor(rates, losses) {
    const fromZero = (_plot, _least, most) => [0, most > 0 ? 1.08 * most : 1];
    this.rates = chart(rates, [["pairs or photons made /s", "--quantum"], ["photons arrived /s", "--openflow"]], fromZero, false);
    this.losses = chart(losses, [["photons lost (%)", "--bad"]], [0, 100], true); // known only of what came
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      for (const plot of [this.rates, this.losses]) plot.redraw();
    });
  }

  show(state) {
    const last = Math.floor(state.t / BUCKET_S), buckets = [...state.buckets.keys()];
    const first = Math.max(buckets.length ? Math.min(...buckets) : 0, last - WINDOW_S / BUCKET_S);
    const width = Math.max(1, Math.ceil((last - first + 1) / MOST_POINTS));
    const x = [], pairs = [], arrived = [], lost = [];
    // The newest is not over yet, and would be drawn as a fall; where there are few, it is all there is.
    const end = last - first > MANY ? last - width : last;
    const unknown = Math.floor(unknownSince(state) / BUCKET_S);
    for (let begin = first; begin <= end; begin += width) {
      const sum = { pairs: 0, arrived: 0, lost: 0 };
      for (let n = begin; n < begin + width; n++) {
        const each = state.buckets.get(n);
        if (each) for (const name in sum) sum[name] += each[name];
      }
      x.push(begin * BUCKET_S);
      const known = begin + width <= unknown;
      pairs.push(known ? sum.pairs / (width * BUCKET_S) : null);
      arrived.push(known ? sum.arrived / (width * BUCKET_S) : null);
      lost.push(sum.arrived + sum.lost ? (100 * sum.lost) / (sum.arrived + sum.lost) : null);
    }
    for (const [plot, data] of [[this.rates, [x, pairs, arrived]], [this.losses, [x, lost]]]) {
      // A single point, or nothing but 0, is no curve: the tables have it.
      plot.root.closest("section").hidden = !data.slice(1).some((each) => each.filter((value) => value != null).length > 1 && each.some(Boolean));
      plot.setData(data);
      if (plot.cursor.idx == null && x.length) plot.setLegend({ idx: newest(data) }); // else what is pointed at
    }
  }
}

// The last place of which something is known.
function newest([x, ...series]) {
  for (let n = x.length - 1; n > 0; n--) if (series.some((each) => each[n] != null)) return n;
  return 0;
}

// Series are a label, a colour, and how thick the line is.
export function chart(at, series, range, gaps, { bands = [], values = undefined, live = true } = {}) {
  const axis = { stroke: () => colour("--muted"), grid: { stroke: () => colour("--grid"), width: 1 } };
  const shown = (_plot, value) => (value == null ? "-" : value.toLocaleString("en", { maximumSignificantDigits: 4 }));
  const number = (_plot, values) => values.map((value) => value.toLocaleString("en", { notation: "compact" }));
  const seconds = (_plot, values) => values.map((value) => value && value < 0.1 ? `${Number((1000 * value).toPrecision(4))} ms` : `${Number(value.toPrecision(6))} s`);
  const options = {
    width: Math.max(at.clientWidth, 200), height: HEIGHT, legend: { live },
    scales: { x: { time: false }, y: { range } },
    bands,
    axes: [{ ...axis, values: seconds }, { ...axis, size: 56, values: values ?? number }],
    series: [
      { label: "time", value: (_plot, value) => (value == null ? "-" : `${value.toFixed(1)} s`) },
      ...series.map(([label, name, width = 1.5]) => ({ label, stroke: () => colour(name), width, spanGaps: gaps, value: shown })),
    ],
  };
  const plot = new uPlot(options, [[], ...series.map(() => [])], at);
  new ResizeObserver(() => plot.setSize({ width: Math.max(at.clientWidth, 200), height: HEIGHT })).observe(at);
  return plot;
}
