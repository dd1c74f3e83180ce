// The newest handshake: the server draws it when it is looked at, and again for another session.

const SETTLED_S = 1; // behind the beginning of a session: its handshake is over
const CHEAP_MS = 1000; // to draw it: what takes longer is drawn by the button alone, after the first time

export class Ladder {
  constructor(place, button) {
    Object.assign(this, { place, button, seen: false, of: null, took: 0, newest: null });
    button.addEventListener("click", () => this.draw());
    new IntersectionObserver(([entry]) => { this.seen = entry.isIntersecting; this.look(); }).observe(place.parentElement);
  }

  changed(state, busy) {
    let newest = null;
    for (const each of state.sessions.values()) if (each.over || state.t - each.since > SETTLED_S) newest = each.id;
    this.newest = newest;
    if (!busy || this.of === null) this.look();
  }

  look() {
    if (this.seen && this.newest && this.newest !== this.of && !this.button.disabled && this.took < CHEAP_MS) this.draw();
  }

  async draw() {
    const began = performance.now(), of = this.newest;
    this.button.disabled = true;
    if (!this.place.childNodes.length) this.place.textContent = "drawing …";
    try {
      this.place.innerHTML = await (await fetch("handshake")).text();
    } catch (error) {
      this.place.textContent = `The view does not answer (${error.message}): has the network ended?`;
    }
    Object.assign(this, { of: of ?? "", took: performance.now() - began });
    this.button.disabled = false;
  }
}
