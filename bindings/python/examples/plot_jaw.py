"""Plots the jaw over the waveform: python plot_jaw.py SPEECH.wav OUT.png     (needs matplotlib; 16-bit WAV files)"""

import sys
import wave

import matplotlib.pyplot as plt
import numpy as np

import umo

with wave.open(sys.argv[1]) as file:
    rate = file.getframerate()
    samples = np.frombuffer(file.readframes(file.getnframes()), "<i2").reshape(-1, file.getnchannels())

motion = umo.animate(samples, rate)

figure, axis = plt.subplots(figsize=(10, 3), layout="constrained")
axis.plot(np.arange(len(samples)) / rate, samples.mean(1) / 32768, color="0.75", linewidth=0.5, label="speech")
axis.plot(motion.times, motion.channel("jawOpen"), label="jawOpen")
axis.set(xlabel="seconds", ylim=(-1, 1), title=f"{len(motion)} frames from {len(samples) / rate:.1f} s of speech")
axis.legend(loc="upper right")
figure.savefig(sys.argv[2], dpi=120)
