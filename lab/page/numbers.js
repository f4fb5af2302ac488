// Numbers as people read them: four digits, units in which they are neither huge nor tiny.

const SCALED = {
  m: [["m", 1], ["mm", 1e3]],
  "m^2": [["m²", 1], ["mm²", 1e6]],
  J: [["J", 1], ["kJ", 1e-3]],
};

const PRETTY = {"^2": "²", "^3": "³", "^-1": "⁻¹", "*": "·"};

export function unitText(unit) {
  if (!unit || unit === "1") return "";
  return unit.replace(/\^2|\^3|\^-1|\*/g, (found) => PRETTY[found]);
}

// Unit and factor in which the largest of some values is easily read.
export function scaleFor(unit, values) {
  const largest = Math.max(0, ...values.filter(Number.isFinite).map(Math.abs));
  const scales = SCALED[unit];
  if (!scales) return {unit: unitText(unit), factor: 1};
  const small = unit === "J" ? largest >= 1e4 : largest < 0.5;
  const [name, factor] = scales[small ? 1 : 0];
  return {unit: name, factor};
}

export function digits(value, count = 4) {
  if (value === null || value === undefined || Number.isNaN(value)) return "–";
  if (!Number.isFinite(value)) return value > 0 ? "∞" : "−∞";
  if (value === 0) return "0";
  const size = Math.abs(value);
  let text;
  if (size >= 1e6 || size < 1e-4) {
    const [mantissa, exponent] = value.toExponential(count - 1).split("e");
    text = `${trimmed(mantissa)}e${Number(exponent)}`;
  } else if (size >= 10 ** (count - 1)) {
    text = Math.round(value).toString();
  } else {
    text = trimmed(value.toPrecision(count));
  }
  return text.replaceAll("-", "−").replace(/^(−?\d{1,3})(\d{3})$/, "$1\u2009$2");
}

function trimmed(text) {
  return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}

// A number as a field or a file holds it: no more digits than it needs.
export function plain(value) {
  return value === null ? "" : String(Number(value.toPrecision(6)));
}

export function change(from, to) {
  if (!Number.isFinite(from) || !Number.isFinite(to) || from === to) return from === to ? "=" : "–";
  if (from === 0) return `+${digits(to, 3)}`;
  const share = (to - from) / Math.abs(from);
  if (Math.abs(share) >= 10) return `× ${digits(to / from, 3)}`;
  return `${share < 0 ? "−" : "+"}${(100 * Math.abs(share)).toFixed(Math.abs(share) < 0.1 ? 1 : 0)} %`;
}
