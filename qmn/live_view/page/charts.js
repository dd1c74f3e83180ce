// Rates and losses over time, by uPlot.

import uPlot from "./uplot/uPlot.esm.js";
import { BUCKET_S, WINDOW_S } from "./state.js";

const MOST_POINTS = 400, MANY = 20, HEIGHT = 170;
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export class Charts {
  constructor(rates, losses) {
    this.rates = chart(rates, [["pairs made /s", "--quantum"], ["photons arrived /s", "--openflow"]]);
    this.losses = chart(losses, [["photons lost (%)", "--bad"]]);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      for (const plot of [this.rates, this.losses]) plot.redraw();
    });
  }

  show(state) {
    const last = Math.floor(state.t / BUCKET_S), buckets = [...state.buckets.keys()];
    const first = Math.max(buckets.length ? buckets[0] : 0, last - WINDOW_S / BUCKET_S);
    const width = Math.max(1, Math.ceil((last - first + 1) / MOST_POINTS));
    const x = [], pairs = [], arrived = [], lost = [];
    // The newest is not over yet, and would be drawn as a fall; where there are few, it is all there is.
    const end = last - first > MANY ? last - width : last;
    for (let begin = first; begin <= end; begin += width) {
      const sum = { pairs: 0, arrived: 0, lost: 0 };
      for (let n = begin; n < begin + width; n++) {
        const each = state.buckets.get(n);
        if (each) for (const name in sum) sum[name] += each[name];
      }
      x.push(begin * BUCKET_S);
      pairs.push(sum.pairs / (width * BUCKET_S));
      arrived.push(sum.arrived / (width * BUCKET_S));
      lost.push(sum.arrived + sum.lost ? (100 * sum.lost) / (sum.arrived + sum.lost) : null);
    }
    this.rates.setData([x, pairs, arrived]);
    this.losses.setData([x, lost]);
  }
}

function chart(at, series) {
  const axis = { stroke: () => colour("--muted"), grid: { stroke: () => colour("--grid"), width: 1 } };
  const number = (_plot, values) => values.map((value) => value.toLocaleString("en", { notation: "compact" }));
  const options = {
    width: Math.max(at.clientWidth, 200), height: HEIGHT,
    scales: { x: { time: false } },
    axes: [{ ...axis, values: (_plot, values) => values.map((value) => `${value} s`) }, { ...axis, size: 56, values: number }],
    series: [
      { label: "time", value: (_plot, value) => (value === null ? "-" : `${value?.toFixed(1)} s`) },
      ...series.map(([label, name]) => ({ label, stroke: () => colour(name), width: 1.5, spanGaps: false })),
    ],
  };
  const plot = new uPlot(options, [[], ...series.map(() => [])], at);
  new ResizeObserver(() => plot.setSize({ width: Math.max(at.clientWidth, 200), height: HEIGHT })).observe(at);
  return plot;
}
