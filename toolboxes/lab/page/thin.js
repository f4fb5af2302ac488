// Thinning of rows for small figures, without losing peaks.

// The number of largest magnitude, with its sign, of each of `count` intervals.
export function extremes(column, count) {
  const thin = new Float64Array(Math.min(count, column.length));
  for (let index = 0; index < thin.length; index++) {
    const end = Math.floor((index + 1) * column.length / thin.length);
    let largest = 0;
    for (let row = Math.floor(index * column.length / thin.length); row < end; row++) {
      if (Math.abs(column[row]) > Math.abs(largest)) largest = column[row];
    }
    thin[index] = largest;
  }
  return thin;
}

// The first number of each interval.
export function samples(column, count) {
  const length = Math.min(count, column.length);
  return Float64Array.from({length}, (_, index) => column[Math.floor(index * column.length / length)]);
}
