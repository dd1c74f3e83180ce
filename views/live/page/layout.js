// Rectangles on the screen of which no two overlap, in cells: few are near to one.
export class Taken {
  constructor(size) {
    Object.assign(this, { size, cells: new Map() });
  }

  // Take a place; false if there is no room, unless it must be had.
  take(place, must = false) {
    const cells = [];
    for (let x = Math.floor(place.left / this.size); x <= place.right / this.size; x++) {
      for (let y = Math.floor(place.top / this.size); y <= place.bottom / this.size; y++) cells.push(`${x} ${y}`);
    }
    const beside = (one) => one.right <= place.left || place.right <= one.left || one.bottom <= place.top || place.bottom <= one.top;
    if (!must && !cells.every((cell) => (this.cells.get(cell) ?? []).every(beside))) return false;
    for (const cell of cells) this.cells.set(cell, [...(this.cells.get(cell) ?? []), place]);
    return true;
  }
}

export function around({ x, y }, width, height) {
  return { left: x - width / 2, right: x + width / 2, top: y - height / 2, bottom: y + height / 2 };
}
