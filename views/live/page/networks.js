// The networks of one address, of a command or a machine: which there are, which run, and the way to another.

const LOOK_MS = 1000;

export class Networks {
  // `number` is that of the network shown, 0 if it is the only one; `status` shows it.
  constructor(number, list, view, status) {
    Object.assign(this, { number, list, view, status, names: {}, running: [], over: false });
    if (!number) return;
    list.addEventListener("change", () => location.assign(`../${list.value}/`));
    this.look();
  }

  async look() {
    try {
      const answer = await fetch(this.view.ended ? "../networks?next" : "../networks");
      Object.assign(this, await answer.json());
      if (!this.running.includes(this.number)) this.view.ended = true; // it may have been killed
    } catch {
      this.over = this.view.ended = true; // the command has ended, and nobody answers any more
    }
    const next = this.next();
    if (this.view.ended && this.view.follow && next) return location.replace(`../${next}/`);
    this.show();
    this.status();
    if (!this.over) setTimeout(() => this.look(), LOOK_MS);
  }

  // The newest that runs, beside the one shown; none: undefined.
  next() {
    return this.over ? undefined : this.running.filter((each) => each !== this.number).at(-1);
  }

  show() {
    const shown = this.over ? [this.number] : [...new Set([...this.running, this.number])].sort((a, b) => a - b);
    const words = shown.map((each) => `${each}: ${this.names[each] ?? ""}`);
    if (this.words === words.join()) return;
    this.words = words.join();
    this.list.closest("label").hidden = shown.length < 2;
    this.list.replaceChildren(...shown.map((each, place) => new Option(words[place], each, false, each === this.number)));
  }

  // The status of the network shown, if all is well with the connection.
  describe(live) {
    if (!this.number) return this.view.ended ? "the network has ended" : live;
    const before = Object.keys(this.names).map(Number).filter((each) => each < this.number);
    const ended = before.filter((each) => !this.running.includes(each)).length;
    if (!this.view.ended) return `${live}: network ${this.number}${ended > 0 ? `; ${ended} before it ${ended > 1 ? "have" : "has"} ended` : ""}`;
    const next = this.over ? "and its command" : this.next() ? `and network ${this.next()} runs: see latest` : "the next one has not started yet";
    return `network ${this.number} has ended, ${next}`;
  }
}
