"""The stroke library: readers, cutting, and its use by the performer."""

import json
import struct

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from test_performer_speech import SENTENCES, speech
from umo_train.performer import STYLES, captures, gestures, strokes
from umo_train.performer.arm_track import RETIME
from umo_train.performer.arms import WRIST
from umo_train.performer.captures import RATE, Arms
from umo_train.performer.curves import BENDS, bends, ease
from umo_train.performer.prosody import listen


@pytest.fixture(scope="module")
def library():
    return strokes.library()


def test_the_library_is_of_captures(library):
    assert len(library) > 250
    assert library.bend.shape == (len(library), BENDS, 3)
    assert {"basketball_signal_1", "directing_traffic_1", "Victory"} <= set(library.sources)
    assert np.isfinite(library.bend).all() and (library.seconds > 0.19).all() and (library.hold >= 0.0).all()
    # Longer strokes take longer, but far less than in proportion, as people move.
    ways = np.log(np.linalg.norm(library.end - library.start, axis=1))
    assert 0.2 < np.polyfit(ways, np.log(library.seconds), 1)[0] < 0.6


def test_cut_finds_a_movement_and_its_bend():
    t = np.arange(0.0, 3.0, 1.0 / RATE)
    s = np.clip((t - 1.0) / 0.6, 0.0, 1.0)
    wrist = np.array([0.2, -0.3, 0.2]) + ease(s)[:, None] * np.array([0.2, 0.15, 0.1])
    bow = 0.06 * bends(s)[:, :1] * np.array([[0.0, -0.4, 0.6]])
    still = np.tile([0.2, -0.48, 0.05], (len(t), 1))
    found = strokes.cut([Arms("made", np.stack([wrist + bow, still]), np.zeros((2, len(t), 3)))])
    assert len(found) == 1
    assert 0.45 < found.seconds[0] < 0.7
    np.testing.assert_allclose(found.end[0] - found.start[0], [0.2, 0.15, 0.1], atol=0.02)
    np.testing.assert_allclose(found.bend[0, 0], [0.0, -0.024, 0.036], atol=0.012)
    assert found.hold[0] > 1.0 and found.partner[0] == -1


def test_a_bend_turns_with_its_way(library):
    start = np.array([0.2, -0.3, 0.2])
    index = int(np.argmax(np.abs(library.bend).max(axis=(1, 2))))
    way = library.end[index] - library.start[index]
    np.testing.assert_allclose(library.bent(index, start, start + way), library.bend[index], atol=1e-9)
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5]).as_matrix()
    turned = library.bent(index, start, start + 2.0 * turn @ way)
    np.testing.assert_allclose(
        np.linalg.norm(turned, axis=1), 2.0 * np.linalg.norm(library.bend[index], axis=1), rtol=1e-6
    )
    assert np.allclose(turned @ (turn @ way), 2.0 * library.bend[index] @ way, atol=1e-9)


def test_written_and_read_again(tmp_path, library):
    strokes.write(tmp_path / "again.npz", library)
    again = strokes.read(tmp_path / "again.npz")
    for name in strokes.Strokes.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(library, name))


def test_cmu_reads_places_of_arms(tmp_path):
    parents = np.array([-1, 0, 1, 2, 3, 4, 5, 0, 7, 8, 9, 10, 11, 0, 13, 14, 15, 16, 17, 18, 15, 20, 21, 22, 23, 24,
                        25, 23, 27, 15, 29, 30, 31, 32, 33, 34, 32, 36])  # fmt: skip
    offsets = np.zeros((38, 3))
    offsets[[14, 15]] = [0.0, 200.0, 0.0]
    for shoulder, elbow, wrist, side in ((21, 22, 23, 1.0), (30, 31, 32, -1.0)):
        offsets[[shoulder, elbow, wrist]] = side * np.array([[200.0, 100.0, 0.0], [300.0, 0.0, 0.0], [200.0, 0.0, 0.0]])
        offsets[shoulder, 1] = 100.0
    expmap = np.zeros((240, 117))
    # The left elbow bends by 90 degrees: the forearm points forward.
    expmap[:, 3 + 3 * 22 + 1] = np.pi / 2
    whole = dict(expmap=expmap, parent=parents, offset_mm=offsets, fps=np.array(120.0))
    np.savez(tmp_path / "a.npz", **whole)
    read = captures.cmu(tmp_path / "a.npz")
    assert read.wrist.shape == (2, 120, 3)
    scale = (captures.UPPER_M + captures.FORE_M) / 0.5
    np.testing.assert_allclose(read.wrist[0, 60], np.array([0.5, 0.0, 0.2]) * scale + [0.0, 0.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(read.wrist[1, 60], np.array([0.7, 0.0, 0.0]) * scale, atol=1e-6)
    del whole["parent"]
    np.savez(tmp_path / "b.npz", **whole)
    with pytest.raises(ValueError, match="no array parent"):
        captures.cmu(tmp_path / "b.npz")
    np.savez(tmp_path / "c.npz", **whole | {"parent": parents, "expmap": expmap[:, :60]})
    with pytest.raises(ValueError, match="does not fit 38 joints"):
        captures.cmu(tmp_path / "c.npz")


def _glb(path, names):
    """Two arms held out, the left forearm rotating; a node per name."""
    rest = {"pelvis": (0, 1, 0), "spine_03": (0, 0.4, 0), "upperarm_l": (0.2, 0, 0), "upperarm_r": (-0.2, 0, 0)}
    rest |= {"lowerarm_l": (0.3, 0, 0), "lowerarm_r": (-0.3, 0, 0), "hand_l": (0.25, 0, 0), "hand_r": (-0.25, 0, 0)}
    children = {"pelvis": ["spine_03"], "spine_03": ["upperarm_l", "upperarm_r"], "upperarm_l": ["lowerarm_l"],
                "upperarm_r": ["lowerarm_r"], "lowerarm_l": ["hand_l"], "lowerarm_r": ["hand_r"]}  # fmt: skip
    index = {name: k for k, name in enumerate(rest)}
    nodes = [{"name": names.get(n, n), "translation": rest[n], "children": [index[c] for c in children.get(n, ())]}
             for n in rest]  # fmt: skip
    times = np.array([0.0, 1.0], "<f4").tobytes()
    turns = Rotation.from_rotvec([[0.0, 0.0, 0.0], [0.0, -np.pi / 2, 0.0]]).as_quat().astype("<f4").tobytes()
    clip = {"name": "Turn", "samplers": [{"input": 0, "output": 1}],
            "channels": [{"sampler": 0, "target": {"node": index["lowerarm_l"], "path": "rotation"}}]}  # fmt: skip
    scene = {"nodes": nodes, "animations": [clip], "accessors": [
        {"bufferView": 0, "componentType": 5126, "count": 2, "type": "SCALAR"},
        {"bufferView": 1, "componentType": 5126, "count": 2, "type": "VEC4"}],
        "bufferViews": [{"buffer": 0, "byteOffset": 0, "byteLength": 8},
                        {"buffer": 0, "byteOffset": 8, "byteLength": 32}]}  # fmt: skip
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", 40, 0x004E4942) + times + turns
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body)


def test_gltf_reads_clips(tmp_path):
    _glb(tmp_path / "turn.glb", {})
    (clip,) = captures.gltf(tmp_path / "turn.glb")
    assert clip.name == "Turn"
    scale = (captures.UPPER_M + captures.FORE_M) / 0.55
    np.testing.assert_allclose(clip.wrist[0, 0], np.array([0.75, 0.0, 0.0]) * scale, atol=0.01)
    np.testing.assert_allclose(clip.wrist[0, -1], np.array([0.5, 0.0, 0.25]) * scale, atol=0.02)
    np.testing.assert_allclose(clip.wrist[1, -1], np.array([0.75, 0.0, 0.0]) * scale, atol=1e-6)


def test_gltf_without_known_arms_or_form_is_refused(tmp_path):
    _glb(tmp_path / "other.glb", {"hand_l": "paw"})
    with pytest.raises(ValueError, match="no nodes named as in"):
        captures.gltf(tmp_path / "other.glb")
    (tmp_path / "none.glb").write_bytes(b"glTF")
    with pytest.raises(ValueError, match="not a glTF file"):
        captures.gltf(tmp_path / "none.glb")


@pytest.mark.parametrize("style", ["neutral", "explaining", "excited"])
def test_strokes_are_captured_ones_retimed(style):
    heard = listen(speech(SENTENCES * 4))
    factors, sources = [], 0
    for seed in range(4):
        made = gestures.gesticulate(heard, STYLES[style], np.random.default_rng(seed))
        for arm in made.made:
            factors += [stroke.seconds / stroke.captured for stroke in arm]
            sources += len(arm)
    assert sources > 40
    assert RETIME[0] - 1e-9 <= min(factors) and max(factors) <= RETIME[1] + 1e-9
    assert np.std(factors) > 0.05


def test_phrases_last_as_peoples_do():
    heard = listen(speech(SENTENCES * 6))
    for style in ("neutral", "explaining"):
        lengths = []
        for seed in range(6):
            for phrase in gestures.plan(heard, STYLES[style], np.random.default_rng(seed)):
                assert phrase.last > phrase.first
                lengths.append(heard.accents[phrase.last - 1] - heard.accents[phrase.first])
        assert 2.0 <= np.median(lengths) <= 6.0


def test_hands_differ():
    """If both arms gesture, they are not mirror images: centimetres apart, on different paths."""
    heard = listen(speech(SENTENCES * 6))
    apart = []
    for seed in range(4):
        made = gestures.gesticulate(heard, STYLES["explaining"], np.random.default_rng(seed))
        both = (made.phases > 0).all(axis=0)
        left, right = made.states[..., WRIST]
        apart.append(np.linalg.norm(left - right, axis=-1)[both])
    assert np.percentile(np.concatenate(apart), 10) > 0.015
    assert np.median(np.concatenate(apart)) > 0.05
