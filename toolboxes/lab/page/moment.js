// Columns of a run at a time, interpolated linearly between rows.
export function moment(run, time) {
  const {t} = run;
  const step = t.length > 1 ? (t[t.length - 1] - t[0]) / (t.length - 1) : 1;
  const position = Math.min(Math.max((time - t[0]) / step, 0), t.length - 1);
  const row = Math.min(Math.floor(position), Math.max(t.length - 2, 0)), share = position - row;
  return (name) => {
    const column = run.columns[name];
    return column ? column[row] + share * ((column[Math.min(row + 1, t.length - 1)] ?? 0) - column[row]) : NaN;
  };
}
