// Current motion time: that of the audio if there is any, so that sound and picture stay in sync.

import { wav } from "umo/scene.js";

export class Clock {
  constructor(scene, seconds) {
    this.seconds = seconds;
    this.at = 0;
    this.rate = 1;
    this.playing = false;
    this.ended = () => {};
    if (scene.samples.length > 0) {
      this.audio = new Audio(URL.createObjectURL(wav(scene.samples, scene.audio.sampleRate)));
      this.audio.preload = "auto";
      this.audio.preservesPitch = true;
    }
  }

  /** Seconds from the start. */
  get time() {
    if (!this.playing) return this.at;
    const { audio } = this;
    const now = audio && !audio.ended ? audio.currentTime : this.since.at + (this.now() - this.since.now) * this.rate;
    this.at = Math.min(Math.max(this.at, now), this.seconds);
    if (audio && !audio.ended) this.mark();
    if (this.at >= this.seconds) {
      this.pause();
      this.ended();
    }
    return this.at;
  }

  /** Seconds of a clock that goes on. */
  now() {
    return performance.now() / 1000;
  }

  mark() {
    this.since = { at: this.at, now: this.now() };
  }

  /** Starts playback; browsers refuse it before the user has interacted with the page. */
  async play() {
    if (this.playing) return;
    if (this.at >= this.seconds - 1e-3) this.seek(0);
    // An unknown duration is NaN, which must not mute the audio.
    if (this.audio && !(this.at >= this.audio.duration)) {
      this.audio.currentTime = this.at;
      this.audio.playbackRate = this.rate;
      await this.audio.play();
    }
    this.playing = true;
    this.mark();
  }

  pause() {
    this.playing = false;
    this.audio?.pause();
  }

  seek(seconds) {
    this.at = Math.min(Math.max(seconds, 0), this.seconds);
    if (this.audio) this.audio.currentTime = this.at;
    this.mark();
  }

  setRate(rate) {
    this.mark();
    this.rate = rate;
    if (this.audio) this.audio.playbackRate = rate;
  }
}
