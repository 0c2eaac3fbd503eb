"""Whatever a file holds: our own error in one line, or an answer; no hang, no crash, no gigabyte."""

from __future__ import annotations

import base64
import io
import json
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from fuzz_mutations import bytes_of, csv_of, json_of, mcap_of, tree_of, urdf_of, yaml_of
from hypothesis import given
from hypothesis import strategies as st

DATA = st.data()


def put(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@pytest.mark.parametrize("name", ["plain", "none", "zstd", "lz4"])
@given(data=DATA)
def test_mcap(reader: Any, sound: Path, place: Path, name: str, data: Any) -> None:
    content = (sound / f"bag-{name}.mcap").read_bytes()
    reader.read("bag", put(place / "a.mcap", data.draw(st.one_of(mcap_of(content), bytes_of(content)))))


@pytest.mark.parametrize("name", ["bag-rosbags.db3", "bag-rosbags.mcap.zstd"])
@given(data=DATA)
def test_other_bags(reader: Any, sound: Path, place: Path, name: str, data: Any) -> None:
    file = place / f"a{''.join(Path(name).suffixes)}"
    reader.read("bag", put(file, data.draw(bytes_of((sound / name).read_bytes()))))


@given(data=DATA)
def test_metadata_of_a_folder(reader: Any, sound: Path, place: Path, data: Any) -> None:
    folder = place / "bag"
    folder.mkdir(exist_ok=True)
    put(folder / "bag_0.mcap", (sound / "bag-folder" / "bag-folder_0.mcap").read_bytes())
    metadata = yaml.safe_load((sound / "bag-folder" / "metadata.yaml").read_text())
    put(folder / "metadata.yaml", data.draw(yaml_of(metadata)))
    reader.read("bag", folder)


@given(data=DATA)
def test_csv(reader: Any, sound: Path, place: Path, data: Any) -> None:
    text = (sound / "table-arm.csv").read_text()
    reader.read("table", put(place / "a.csv", data.draw(st.one_of(csv_of(text), bytes_of(text.encode())))))


ARRAYS = (
    lambda a: a[:-1],
    lambda a: a.T,
    lambda a: a.astype(np.float32),
    lambda a: a.astype(object),
    lambda a: a.astype(str),
    lambda a: a.astype(complex),
    lambda a: a.astype(bool),
    lambda a: np.zeros_like(a),
    lambda a: a[:0],
    lambda a: a[:1],
    lambda a: a[:2],
    lambda a: a * 1e300,
    lambda a: a * 1e-300,
    lambda a: a - a + 1e17,
    lambda a: np.where(a > 0, a, np.nan),
    lambda a: np.where(a > 0, a, np.inf),
    lambda a: a[..., None],
    lambda a: np.repeat(a, 2, axis=0),
    lambda a: a[::-1],
    lambda a: np.round(a, 1),
    lambda a: a.ravel()[0],
    lambda a: np.broadcast_to(a.ravel()[0], (1 << 22,)),
)


@given(data=DATA)
def test_npz(reader: Any, sound: Path, place: Path, data: Any) -> None:
    content = (sound / "table-arm.npz").read_bytes()
    if data.draw(st.booleans()):
        with np.load(io.BytesIO(content)) as archive:
            arrays = {key: archive[key] for key in archive.files}
        for key in data.draw(st.lists(st.sampled_from(sorted(arrays)), min_size=1, max_size=3, unique=True)):
            if key != "names":
                arrays[key] = data.draw(st.sampled_from(ARRAYS))(arrays[key])
            elif data.draw(st.booleans()):
                del arrays[key]
            else:
                arrays[key] = np.array(
                    data.draw(st.sampled_from((["a"] * 3, [1, 2, 3], [["a"]], [None], ["\0", "", "\n"])))
                )
        with np.errstate(all="ignore"):
            np.savez_compressed(stream := io.BytesIO(), **arrays)
        content = stream.getvalue()
    else:
        content = data.draw(bytes_of(content))
    reader.read("table", put(place / "a.npz", content))


@pytest.mark.parametrize("name", ["robot-spring.yaml", "excitation.yaml", "excitation-points.yaml", "model.yaml"])
@given(data=DATA)
def test_yaml(reader: Any, sound: Path, place: Path, name: str, data: Any) -> None:
    content = yaml.load((sound / name).read_text(), Loader=yaml.CSafeLoader)
    target = name.partition(".")[0].partition("-")[0]
    reader.read(target, put(place / name, data.draw(yaml_of(content))))


@given(data=DATA)
def test_urdf(reader: Any, sound: Path, place: Path, data: Any) -> None:
    reader.read("urdf", put(place / "a.urdf", data.draw(urdf_of((sound / "urdf-arm.urdf").read_text()))))


@given(data=DATA)
def test_sealed(reader: Any, sound: Path, place: Path, data: Any) -> None:
    whole = json.loads((sound / "sealed.sealed").read_text())
    if data.draw(st.booleans()):
        answer = json.loads(zlib.decompress(base64.b64decode(whole["sealed"])))
        other = json.dumps(data.draw(tree_of(answer)), default=str)
        whole["sealed"] = base64.b64encode(zlib.compress(other.encode())).decode()
        content = json.dumps(whole).encode()
    else:
        content = data.draw(json_of(whole))
    reader.read("sealed", put(place / "a.sealed", content))
