// Drawings of the newest session: the server makes one when it is looked at, and again for another session.

const SETTLED_S = 1; // behind the beginning of a session: its handshake is over
const CHEAP_MS = 1000; // to draw it: what takes longer is drawn by the button alone, after the first time
const AGAIN_MS = 6000; // until what there was not yet is asked for again

export class ServerDrawing {
  constructor(place, button) { // the place has the name of the drawing
    Object.assign(this, { place, button, seen: false, of: null, took: 0, newest: null, busy: false });
    button?.addEventListener("click", () => this.draw());
    new IntersectionObserver(([entry]) => { this.seen = entry.isIntersecting; this.look(); }).observe(place.parentElement);
  }

  changed(state, busy) {
    let newest = null;
    for (const each of state.sessions.values()) if (each.over || state.t - each.since > SETTLED_S) newest = each.id;
    this.newest = newest;
    if (!busy || this.of === null) this.look();
  }

  look() {
    if (this.seen && this.newest && this.newest !== this.of && !this.busy && this.took < CHEAP_MS) this.draw();
  }

  async draw() {
    const began = performance.now(), of = this.newest, { place, button } = this;
    const work = (busy) => { this.busy = busy; if (button) button.disabled = busy; };
    work(true);
    if (button && !place.childNodes.length) place.textContent = "drawing …";
    try {
      place.innerHTML = await (await fetch(place.id)).text();
    } catch (error) {
      place.textContent = `The view does not answer (${error.message}): has the network ended?`;
    }
    Object.assign(this, { of: of ?? "", took: performance.now() - began });
    if (!place.childNodes.length) setTimeout(() => { this.of = null; this.look(); }, AGAIN_MS);
    work(false);
  }
}
