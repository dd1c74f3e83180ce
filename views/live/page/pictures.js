// When pictures are drawn: as messages come, and while something moves by itself; no others.

const PICTURE_MS = 40; // between two pictures, at least
const MOVES_MS = 80; // the same, where nothing has come, but something moves
const NUMBERS_MS = 250; // between two pictures in which tables, charts and labels are drawn, too

export class Pictures {
  // `draw(passed, numbers)` draws what is to be seen, `passed` ms behind the last picture, and
  // returns whether something moves.
  constructor(draw) {
    Object.assign(this, { draw, last: performance.now(), numbers: 0, due: Infinity, timer: 0, pause: 0 });
  }

  // The server sends news at an interval in ms. Where it is seldom, as it wants the page to take
  // little of the machine, nothing is drawn between.
  get seldom() {
    return this.pause > NUMBERS_MS;
  }

  // Time passes from now on, and not since the last picture.
  begin() {
    this.last = performance.now();
    this.wake();
  }

  // There is something new. A page that is hidden gets no frame, and draws when it is seen again.
  wake(after = PICTURE_MS) {
    const now = performance.now(), due = Math.max(this.last + after, now);
    if (due >= this.due) return;
    clearTimeout(this.timer);
    this.due = due;
    this.timer = setTimeout(() => requestAnimationFrame(() => this.frame()), due - now);
  }

  frame() {
    const now = performance.now(), passed = now - this.last;
    const left = this.numbers + (this.seldom ? 0.8 * this.pause : NUMBERS_MS) - now; // each, if they are seldom
    this.last = now;
    this.due = Infinity;
    if (left <= 0) this.numbers = now;
    if (this.draw(passed, left <= 0)) this.wake(this.seldom ? 2 * this.pause : MOVES_MS);
    if (left > 0) this.wake(Math.max(left, MOVES_MS)); // if no other picture comes before
  }
}
