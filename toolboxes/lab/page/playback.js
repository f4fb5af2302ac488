// The time shown and its playback: play, pause, slow motion, within the plots' time range.

export class Playback {
  constructor(onMoment) {
    this.onMoment = onMoment;
    this.time = 0;
    this.window = [0, 1];
    this.whole = [0, 1];
    this.speed = 1;
    this.playing = false;
  }

  setWhole(end) {
    const showsAll = this.window[0] === this.whole[0] && this.window[1] === this.whole[1];
    this.whole = [0, end];
    if (showsAll || this.window[1] > end) this.window = [0, end];
    this.seek(Math.min(this.time, end));
  }

  setWindow(low, high) {
    this.window = [Math.max(low, this.whole[0]), Math.min(high, this.whole[1])];
    if (this.time < this.window[0] || this.time > this.window[1]) this.time = this.window[0];
    this.onMoment();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, this.whole[0]), this.whole[1]);
    this.onMoment();
  }

  toggle(playing = !this.playing) {
    this.playing = playing;
    if (playing) {
      if (this.time >= this.window[1] - 1e-9) this.time = this.window[0];
      this.last = performance.now();
      requestAnimationFrame((now) => this.#frame(now));
    }
    this.onMoment();
  }

  #frame(now) {
    if (!this.playing) return;
    this.time += this.speed * Math.min(now - this.last, 100) / 1000;
    this.last = now;
    if (this.time >= this.window[1]) {
      this.time = this.window[1];
      this.playing = false;
    }
    this.onMoment();
    if (this.playing) requestAnimationFrame((next) => this.#frame(next));
  }
}
