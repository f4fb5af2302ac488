// Drawing of the machine at one time: rail, vehicle, drums and ropes to scale, and the error magnified.

import {moment} from "./moment.js";
import {digits, steady} from "./numbers.js";
import {colour} from "./theme.js";

const HEIGHT = 196;
const FONT = '12px "Source Sans 3", "Segoe UI", system-ui, sans-serif';

export class Machine {
  constructor(canvas) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
  }

  // plant: {length, offset, radius, diameter, height, tensionMax}; pinned: a second run, drawn as an outline.
  draw(run, time, plant, pinned = null) {
    const width = this.canvas.clientWidth, dots = devicePixelRatio || 1;
    if (this.canvas.width !== Math.round(width * dots)) {
      this.canvas.width = Math.round(width * dots);
      this.canvas.height = Math.round(HEIGHT * dots);
    }
    this.pen.setTransform(dots, 0, 0, dots, 0, 0);
    this.pen.clearRect(0, 0, width, HEIGHT);
    this.pen.font = FONT;
    const at = moment(run, time), view = this.#view(width, plant);
    view.enlarged = enlargement(run.largestSag * view.scale);
    this.#rail(view, plant);
    this.#rope(view, at, plant, 2);
    this.#rope(view, at, plant, 1);
    this.#drum(view, at, 1);
    this.#drum(view, at, 2);
    if (pinned) this.#outline(view, moment(pinned, time)("x"), "pinned");
    this.#reference(view, at("x_ref"));
    this.#vehicle(view, at("x"));
    this.#pushes(view, at, run.largestDisturbance);
    this.#lens(view, at("x"), at("e"), run.largestError);
    this.#scale(view, plant);
  }

  #view(width, plant) {
    const drum = Math.max(0.8 * plant.radius * width / (plant.length + 8), 13);
    const left = 2 * drum + 10, right = width - left;
    const scale = (right - left) / (plant.length + 2 * plant.offset);
    const vehicle = {width: Math.max(plant.diameter * scale, 18), height: Math.max(plant.height * scale, 27)};
    return {width, drum, left, right, scale, vehicle, rail: 118, origin: left + plant.offset * scale,
      spot: (x) => left + (plant.offset + x) * scale, ropeHeight: 118 - 10 - Math.min(vehicle.height, 54) / 2};
  }

  #rail(view, plant) {
    const {pen} = this;
    pen.strokeStyle = colour("ink-soft");
    pen.fillStyle = colour("ink-soft");
    pen.lineWidth = 1;
    this.#line(view.spot(-plant.offset), view.rail, view.spot(plant.length + plant.offset), view.rail);
    pen.textAlign = "center";
    const labelled = view.scale * 10 > 40 ? 10 : 25;
    for (let x = 0; x <= plant.length + 1e-9; x += 5) {
      const tall = x % labelled === 0;
      this.#line(view.spot(x), view.rail, view.spot(x), view.rail + (tall ? 6 : 3));
      if (tall) pen.fillText(x === 0 ? "0" : x + labelled > plant.length ? `${x} m` : `${x}`, view.spot(x), view.rail + 18);
    }
  }

  #rope(view, at, plant, number) {
    const {pen} = this, force = at(`F${number}`), x = at("x");
    const drumX = number === 1 ? view.right + view.drum + 2 : view.left - view.drum - 2;
    const vehicleX = view.spot(x) + (number === 1 ? 1 : -1) * view.vehicle.width / 2;
    const slack = !(force > 0), top = view.ropeHeight;
    pen.strokeStyle = slack ? colour("ink-soft") : tensionColour(force / plant.tensionMax);
    pen.lineWidth = slack ? 1.5 : 1.5 + 2.5 * Math.min(force / plant.tensionMax, 1.3);
    pen.setLineDash(slack ? [5, 4] : []);
    pen.beginPath();
    pen.moveTo(drumX, top);
    this.#hang(view, plant, at(`sag_${number}`), drumX, vehicleX);
    pen.stroke();
    pen.setLineDash([]);
    pen.fillStyle = colour("ink");
    pen.textAlign = number === 1 ? "right" : "left";
    const edge = number === 1 ? view.width - 4 : 4;
    pen.fillText(`F${number === 1 ? "₁" : "₂"} ${slack ? "slack" : `${digits(force)} N`}`, edge, 15);
    pen.fillStyle = colour("ink-soft");
    pen.fillText(`τ${number === 1 ? "₁" : "₂"} ${digits(at(`tau_${number}`), 3)} N m`, edge, 31);
  }

  // A straight rope, or one that sags from roller to roller, with a shorter last span; sag is scaled by view.enlarged.
  #hang(view, plant, sag, drumX, vehicleX) {
    const {pen} = this, top = view.ropeHeight, depth = sag * view.scale * view.enlarged;
    if (!(depth > 0.2)) return pen.lineTo(vehicleX, top);
    const towards = Math.sign(vehicleX - drumX), end = towards < 0 ? view.spot(plant.length + plant.offset) : view.spot(-plant.offset);
    const whole = plant.spacing * view.scale || Math.abs(vehicleX - end);
    pen.lineTo(end, top);
    for (let from = end; towards * (vehicleX - from) > 0.1;) {
      const part = Math.min(towards * (vehicleX - from), whole), to = from + towards * part;
      pen.quadraticCurveTo((from + to) / 2, top + 2 * depth * (part / whole) ** 2, to, top);
      from = to;
    }
  }

  // A drum at its angle: when it retrieves rope, its top moves away from the vehicle.
  #drum(view, at, number) {
    const {pen} = this, centreX = number === 1 ? view.right + view.drum + 2 : view.left - view.drum - 2;
    const centreY = view.ropeHeight + view.drum, angle = (number === 1 ? 1 : -1) * at(`theta_${number}`);
    pen.lineWidth = 1.5;
    pen.strokeStyle = colour("ink");
    pen.fillStyle = colour("paper");
    pen.beginPath();
    pen.arc(centreX, centreY, view.drum, 0, 2 * Math.PI);
    pen.fill();
    pen.stroke();
    for (let spoke = 0; spoke < 3; spoke++) {
      const direction = angle + spoke * 2 * Math.PI / 3 - Math.PI / 2;
      pen.lineWidth = spoke ? 1 : 3;
      this.#line(centreX, centreY, centreX + 0.82 * view.drum * Math.cos(direction), centreY + 0.82 * view.drum * Math.sin(direction));
    }
    pen.lineWidth = 1;
    pen.strokeStyle = colour("ink-soft");
    this.#line(centreX - view.drum * 0.6, view.rail, centreX, centreY + view.drum);
    this.#line(centreX + view.drum * 0.6, view.rail, centreX, centreY + view.drum);
  }

  #vehicle(view, x) {
    const {pen} = this, {width, height} = view.vehicle, drawn = Math.min(height, 60);
    pen.fillStyle = colour("vehicle");
    pen.strokeStyle = colour("ink");
    pen.lineWidth = 1.5;
    pen.beginPath();
    pen.roundRect(view.spot(x) - width / 2, view.rail - 5 - drawn, width, drawn, Math.min(width / 2, 9));
    pen.fill();
    pen.stroke();
    for (const side of [-0.28, 0.28]) {
      pen.beginPath();
      pen.arc(view.spot(x) + side * width, view.rail - 3, 2.5, 0, 2 * Math.PI);
      pen.fillStyle = colour("ink");
      pen.fill();
    }
  }

  // The disturbance on the vehicle and the controller's estimate of it, as arrows.
  #pushes(view, at, largest) {
    if (!(largest > 1e-4)) return;
    const top = view.rail - 5 - Math.min(view.vehicle.height, 60);
    [["d_true", "ink", 0.3, "disturbance"], ["d_total", "vermilion", 0.66, "as estimated"]].forEach(([name, tint, share, words]) => {
      const length = 44 * Math.min(Math.max(at(name) / largest, -1.4), 1.4), y = top + share * Math.min(view.vehicle.height, 60);
      if (Math.abs(length) < 2) return;
      const start = view.spot(at("x")) + Math.sign(length) * (view.vehicle.width / 2 + 4), tip = start + length, back = 5 * Math.sign(length);
      this.pen.strokeStyle = this.pen.fillStyle = colour(tint);
      this.pen.lineWidth = 2;
      this.#line(start, y, tip, y);
      this.pen.beginPath();
      this.pen.moveTo(tip + back, y);
      this.pen.lineTo(tip - back / 2, y - 3.5);
      this.pen.lineTo(tip - back / 2, y + 3.5);
      this.pen.fill();
      this.pen.textAlign = length > 0 ? "left" : "right";
      this.pen.fillText(words, tip + 2 * back, share < 0.5 ? y - 4 : y + 6);
    });
  }

  #outline(view, x, name) {
    const {pen} = this, {width, height} = view.vehicle, drawn = Math.min(height, 60);
    pen.strokeStyle = colour(name);
    pen.lineWidth = 1;
    pen.setLineDash([3, 3]);
    pen.beginPath();
    pen.roundRect(view.spot(x) - width / 2, view.rail - 5 - drawn, width, drawn, Math.min(width / 2, 9));
    pen.stroke();
    pen.setLineDash([]);
  }

  #reference(view, x) {
    const {pen} = this, spot = view.spot(x), top = view.rail - 14 - Math.min(view.vehicle.height, 60);
    pen.fillStyle = colour("blue");
    pen.beginPath();
    pen.moveTo(spot, top + 6);
    pen.lineTo(spot - 5, top - 3);
    pen.lineTo(spot + 5, top - 3);
    pen.fill();
    pen.textAlign = "center";
    pen.fillText("reference", spot, top - 7);
  }

  // The error, magnified: a millimetre is invisible on a rail of 50 m.
  #lens(view, x, error, largest) {
    const {pen} = this, half = Math.min(92, view.width / 5), range = nice(largest);
    const centre = Math.min(Math.max(view.spot(x), half + 14), view.width - half - 14), base = HEIGHT - 24;
    pen.strokeStyle = colour("line");
    pen.lineWidth = 1;
    this.#line(view.spot(x) - view.vehicle.width / 4, view.rail + 22, centre - half, base - 8);
    this.#line(view.spot(x) + view.vehicle.width / 4, view.rail + 22, centre + half, base - 8);
    pen.strokeStyle = colour("ink-soft");
    pen.fillStyle = colour("ink-soft");
    this.#line(centre - half, base, centre + half, base);
    pen.textAlign = "center";
    for (let tick = -4; tick <= 4; tick++) {
      const spot = centre + tick * half / 4, tall = tick % 4 === 0;
      this.#line(spot, base, spot, base + (tall ? 6 : 3));
    }
    const unit = range < 0.5 ? ["mm", 1e3] : ["m", 1];
    pen.fillText(`−${digits(range * unit[1], 2)}`, centre - half, base + 18);
    pen.fillText(`${digits(range * unit[1], 2)} ${unit[0]}`, centre + half, base + 18);
    const spot = centre + half * Math.min(Math.max(error / range, -1.04), 1.04);
    pen.fillStyle = colour("blue");
    pen.fillText(`e ${steady(error * unit[1], range * unit[1] / 10)}`, centre, base + 18);
    pen.strokeStyle = colour("blue");
    pen.lineWidth = 2.5;
    this.#line(spot, base - 8, spot, base + 1);
  }

  // Colour scale of the rope tensions, and of the enlarged sag.
  #scale(view, plant) {
    const {pen} = this, width = Math.min(120, view.width / 5), left = (view.width - width) / 2;
    for (let pixel = 0; pixel < width; pixel++) {
      pen.fillStyle = tensionColour(pixel / width);
      pen.fillRect(left + pixel, 8, 1.5, 4);
    }
    pen.fillStyle = colour("ink-soft");
    pen.textAlign = "right";
    pen.fillText("tension 0", left - 5, 14);
    pen.textAlign = "left";
    pen.fillText(`${digits(plant.tensionMax / 1000, 2)} kN`, left + width + 5, 14);
    if (!(view.enlarged >= 1)) return;
    pen.textAlign = "center";
    pen.fillText(view.enlarged > 1 ? `sag × ${digits(view.enlarged)}` : "sag to scale", left + width / 2, 30);
  }

  #line(x1, y1, x2, y2) {
    this.pen.beginPath();
    this.pen.moveTo(x1, y1);
    this.pen.lineTo(x2, y2);
    this.pen.stroke();
  }
}

const SHOWN_SAG = 16; // most pixels of the largest sag after enlargement

// Power of ten by which sag is enlarged to be visible; NaN for ropes without sag.
function enlargement(pixels) {
  return pixels > 0 ? 10 ** Math.max(Math.floor(Math.log10(SHOWN_SAG / pixels)), 0) : NaN;
}

// The next larger of 1, 2, 5 · 10ⁿ.
function nice(size) {
  if (!(size > 0) || !Number.isFinite(size)) return 1e-3;
  const power = 10 ** Math.floor(Math.log10(size));
  return [1, 2, 5, 10].find((step) => step * power >= size * 0.999) * power;
}

const STOPS = [[0x56, 0xb4, 0xe9], [0xc9, 0xa2, 0x27], [0xd5, 0x5e, 0x00]];

// Colour from sky blue over gold to vermilion, distinguishable by colour-blind readers; line widths show the same.
function tensionColour(share) {
  const position = Math.min(Math.max(share, 0), 1) * 2, index = Math.min(Math.floor(position), 1), part = position - index;
  return `rgb(${STOPS[index].map((from, channel) => Math.round(from + part * (STOPS[index + 1][channel] - from))).join(",")})`;
}
