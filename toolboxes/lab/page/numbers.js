// Formatting of numbers: four digits, in units that make them neither huge nor tiny.

const SCALED = {
  m: [["m", 1], ["mm", 1e3]],
  "m^2": [["m²", 1], ["mm²", 1e6]],
  J: [["J", 1], ["kJ", 1e-3]],
};

const PRETTY = {"^2": "²", "^3": "³", "^-1": "⁻¹", "*": "·"};

export function unitText(unit) {
  if (!unit || unit === "1") return "";
  return unit.replace(/\^2|\^3|\^-1|\*/g, (found) => PRETTY[found]).replaceAll(" ", "\u202f");
}

// The unit as HTML, with powers as superscripts.
export function unitHtml(unit) {
  return unitText(unit).replace(/\^\(([^)]*)\)/g, (_, power) => `<sup>${power.replaceAll("-", "−")}</sup>`);
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
  return text.replaceAll("-", "−").replace(/^(−?\d{1,3})(\d{3})$/, "$1\u202f$2");
}

function rounded(factor) {
  return factor < 1e4 ? digits(Number(factor.toPrecision(2))) : `10${superscript(Math.round(Math.log10(factor)))}`;
}

function superscript(power) {
  return String(power).replace(/\d/g, (digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[digit]);
}

function trimmed(text) {
  return text.includes(".") ? text.replace(/\.?0+$/, "") : text;
}

// A number for an input field, with as many digits as fit; files and links have all digits.
export function plain(value) {
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e7)) return Number(value.toPrecision(3)).toExponential().replace("e+", "e");
  return String(Number(value.toPrecision(5)));
}

// A fixed number of decimals, that of `largest` with four digits, so that a changing number does not jump.
export function steady(value, largest) {
  if (!Number.isFinite(value)) return "–";
  const decimals = Math.min(Math.max(3 - Math.floor(Math.log10(largest || 1)), 0), 8);
  return value.toFixed(decimals).replace(/^-(?=0(\.0*)?$)/, "").replace("-", "−").replace(/^(−?\d{1,3})(\d{3})$/, "$1\u202f$2");
}

// Change of a number in short form: in percent, or as a factor if it is large.
export function change(from, to) {
  if (!Number.isFinite(from) || !Number.isFinite(to)) return "–";
  if (from === to) return "=";
  if (from === 0) return `+${digits(to, 3)}`;
  const share = (to - from) / Math.abs(from), factor = to / from;
  if (factor >= 10 || (factor > 0 && factor < 0.05)) return factor > 1 ? `× ${rounded(factor)}` : `÷ ${rounded(1 / factor)}`;
  if (Math.abs(share) < 5e-4) return "=";
  return `${share < 0 ? "−" : "+"}${(100 * Math.abs(share)).toFixed(Math.abs(share) < 0.1 ? 1 : 0)} %`;
}
