// Range of a slider: the catalogue's, widened to contain the unchanged value of the key.

export const SLIDER_STEPS = 1000;

// {low, high, kind} of a key; ranges that begin at zero are finer near zero.
export function sliderRange(about, base) {
  let [low, high] = about.slider;
  if (Number.isFinite(base)) [low, high] = [Math.min(low, base), Math.max(high, base)];
  const kind = about.scale === "log" && low > 0 ? "log" : low === 0 && !base && about.kind !== "integer" ? "power" : "linear";
  return {low, high: high > low ? high : low + 1, kind};
}

export function toPosition(range, value) {
  const {low, high, kind} = range;
  const within = Math.min(Math.max(value, low), high);
  if (kind === "log") return SLIDER_STEPS * Math.log(within / low) / Math.log(high / low);
  const share = (within - low) / (high - low);
  return SLIDER_STEPS * (kind === "power" ? Math.sqrt(share) : share);
}

export function toValue(range, position, integer = false) {
  const {low, high, kind} = range;
  const share = position / SLIDER_STEPS;
  const value = kind === "log" ? low * (high / low) ** share : low + (high - low) * (kind === "power" ? share * share : share);
  return integer ? Math.round(value) : Number(value.toPrecision(3));
}
