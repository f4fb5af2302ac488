// Playback controls: play, scrub, slow motion and predefined time ranges.

const STEPS = 1000;

// steady(): time range of constant reference speed, [from, to] in s.
export function connectTransport(playback, steady) {
  const play = document.getElementById("play"), scrub = document.getElementById("scrub"), speed = document.getElementById("speed");
  const clock = document.getElementById("clock");
  play.addEventListener("click", () => playback.toggle());
  speed.addEventListener("change", () => { playback.speed = Number(speed.value); });
  scrub.addEventListener("input", () => {
    const [low, high] = playback.window;
    playback.seek(low + (high - low) * Number(scrub.value) / STEPS);
  });
  const windows = {
    all: () => playback.setWindow(...playback.whole),
    steady: () => playback.setWindow(...steady()),
    ringing: () => {
      speed.value = "0.01";
      playback.speed = 0.01;
      playback.setWindow(0, 0.06);
      playback.seek(0);
      if (!matchMedia("(prefers-reduced-motion: reduce)").matches) playback.toggle(true);
    },
  };
  for (const button of document.querySelectorAll("[data-window]")) button.addEventListener("click", windows[button.dataset.window]);
  return {
    show(text) {
      const [low, high] = playback.window;
      scrub.value = STEPS * (playback.time - low) / (high - low);
      scrub.setAttribute("aria-valuetext", text);
      clock.textContent = `${playback.time.toFixed(high - low < 0.5 ? 4 : high - low < 5 ? 3 : 2)} s`;
      play.textContent = playback.playing ? "❚❚" : "▶";
      play.setAttribute("aria-label", playback.playing ? "Pause" : "Play");
    },
  };
}
