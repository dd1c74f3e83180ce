// The messages that have come, and the state at any of their times.

import { apply, blank } from "./state.js";

const MOST = 100_000; // messages that are kept
const BETWEEN = 10_000; // checkpoints

export class Timeline {
  constructor(names) {
    this.names = names; // of switches by their datapath ids, of hosts by their addresses
    this.messages = [];
    this.checkpoints = [{ count: 0, state: blank() }];
    this.state = blank(); // behind the last message
    this.missed = 0;
  }

  add(messages) {
    for (const message of messages) {
      this.messages.push(message);
      apply(this.state, message, this.names);
      if (this.messages.length % BETWEEN === 0) {
        this.checkpoints.push({ count: this.messages.length, state: structuredClone(this.state) });
      }
    }
    if (this.messages.length > MOST) this.forget();
  }

  // The older half goes: what it has led to is in the first checkpoint that stays.
  forget() {
    const kept = this.checkpoints.filter((each) => each.count >= MOST / 2);
    const gone = kept[0].count;
    this.messages.splice(0, gone);
    for (const each of kept) each.count -= gone;
    this.checkpoints = kept;
    this.missed += gone;
  }

  get end() {
    return this.state.t;
  }

  get begin() {
    return this.missed && this.messages.length ? this.messages[0].t : 0;
  }

  // The state behind all messages up to a time.
  at(t) {
    const before = this.checkpoints.findLast((each) => each.count === 0 || this.messages[each.count - 1].t <= t)
      ?? this.checkpoints[0];
    const state = structuredClone(before.state);
    for (let n = before.count; n < this.messages.length && this.messages[n].t <= t; n++) {
      apply(state, this.messages[n], this.names);
    }
    state.t = t;
    return state;
  }
}
