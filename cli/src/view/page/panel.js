// The panel of a live stream: the source of the sound, and the latency of the picture.

const milliseconds = (seconds) => (seconds === null || seconds === undefined ? "–" : `${(1000 * seconds).toFixed(seconds < 0.1 ? 1 : 0)} ms`);

export function livePanel({ scene, motion, live, $ }) {
  $("#live").hidden = $("#sources").hidden = false;
  const [recording, mouth, stop] = ["#recording", "#microphone", "#stop"].map($);
  const hasRecording = () => scene.samples.length > 0;
  const begin = (source) => live.start(source).catch((error) => live.fail(sayMicrophone(error)));
  recording.addEventListener("click", () => begin("recording"));
  mouth.addEventListener("click", () => begin("microphone"));
  stop.addEventListener("click", () => live.stop());
  live.toggle = () => (live.isRunning || live.clock.playing ? stopAll(live) : begin(hasRecording() ? "recording" : "microphone"));
  live.ends = (time) => {
    const over = live.log.done && live.clock.playing && time >= motion.seconds - 1 / motion.rate;
    if (over) {
      live.clock.pause();
      live.clock.seek(motion.seconds);
    }
    return over;
  };
  const set = (id, words) => {
    $(id).textContent = words;
  };
  let running = null;
  const showButtons = (isRunning) => {
    const state = `${isRunning} ${hasRecording()}`;
    if (state === running) return;
    running = state;
    const hasFocus = [recording, mouth, stop].includes(document.activeElement);
    stop.hidden = !isRunning;
    recording.hidden = isRunning || !hasRecording();
    mouth.hidden = isRunning;
    // The button that replaces the pressed one takes over the focus.
    if (hasFocus) [stop, recording, mouth].find(({ hidden }) => !hidden).focus();
  };
  let said = -Infinity;
  return {
    show() {
      const { started, stats, received, late, error, done, worst, loading } = live.log;
      showButtons(live.isRunning);
      const now = live.clock.now();
      const sentence = live.trouble();
      if ($("#trouble").textContent !== sentence) set("#trouble", sentence);
      const state = error ? "stopped" : live.isRunning ? "live" : done ? "ended" : "ready";
      const kind = live.isRunning ? "live" : "quiet";
      // Limit updates: digits that change every frame are unreadable.
      if (now - said < 0.25 && $("#state").dataset.kind === kind) return;
      said = now;
      const body = milliseconds(started?.bodySeconds ?? scene.live.algorithmicSeconds);
      const behind = live.behind();
      set("#algorithmic", started?.isLive ? `${milliseconds(started.mouthSeconds)} mouth, ${body} body` : body);
      set("#compute", stats ? `${[stats.compute_p50, stats.compute_p99, stats.compute_max].map((x) => Math.round(1000 * x)).join(" / ")} ms` : "–");
      set("#arrival", `${milliseconds(live.arrival())}, most ${milliseconds(worst.arrival)}`);
      set("#behind", `${milliseconds(behind)}, most ${milliseconds(worst.picture)}`);
      set("#received", `${received}${late > 0 ? `, ${late} times late` : ""}`);
      const isLoading = live.isRunning && !started && loading;
      set("#state", isLoading ? `loading the model: ${loading}` : state === "live" && behind !== null ? `live · ${behind.toFixed(2)} s behind the sound` : state);
      $("#state").dataset.kind = kind;
    },
  };
}

function stopAll(live) {
  live.log.done = false;
  live.stop();
}

function sayMicrophone(error) {
  const reasons = { NotAllowedError: "the microphone was refused", NotFoundError: "no microphone was found" };
  return reasons[error.name] ?? `the microphone does not open: ${error.message}`;
}
