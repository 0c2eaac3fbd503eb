"""Who may talk to the workbench, and what it may be told to touch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from robot_ident.errors import InputError
from robot_ident.workbench.app import make_app
from robot_ident.workbench.desk import Desk
from robot_ident.workbench.paths import Allowed
from robot_ident.workbench.save import target
from robot_ident.workbench.server import bind

HOST = {"Host": "127.0.0.1:8050"}


@pytest.fixture
def client(desk: Desk) -> Any:
    return make_app(desk, 8050).server.test_client()


def test_only_this_machines_names_are_answered(client: Any) -> None:
    for name in ("127.0.0.1:8050", "localhost:8050", "[::1]:8050"):
        assert client.get("/", headers={"Host": name}).status_code == 200
    for name in ("evil.example", "evil.example:8050", "127.0.0.1:80", "127.0.0.1.evil.example:8050", "localhost"):
        assert client.get("/", headers={"Host": name}).status_code == 403


def test_pages_of_other_sites_are_refused(client: Any) -> None:
    assert client.get("/_dash-layout", headers={**HOST, "Origin": "http://127.0.0.1:8050"}).status_code == 200
    for more in (
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://localhost:3000"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ):
        assert client.post("/_dash-update-component", headers={**HOST, **more}, json={}).status_code == 403


def test_a_page_may_load_nothing_from_elsewhere(client: Any) -> None:
    answer = client.get("/", headers=HOST)
    assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
    assert "https://" not in answer.text
    assert 'src="//' not in answer.text


def test_assets_lead_to_no_other_file(client: Any) -> None:
    for path in ("/assets/../app.py", "/assets/%2e%2e/app.py", "/assets/..%2f..%2ferrors.py", "/assets//etc/passwd"):
        answer = client.get(path, headers=HOST)
        assert b"import" not in answer.data
        assert b"root:" not in answer.data


@pytest.mark.parametrize("name", ["../other.yaml", "/etc/passwd", "deep/../../other", "link/secret", "a\0b", ""])
def test_paths_stay_below_the_folder(tmp_path: Path, name: str) -> None:
    root = tmp_path / "root"
    root.mkdir()
    (root / "link").symlink_to(tmp_path)
    with pytest.raises(InputError):
        Allowed(root).checked(name)


def test_paths_named_on_the_command_line_may_be_elsewhere(tmp_path: Path) -> None:
    root = tmp_path / "root"
    root.mkdir()
    allowed = Allowed(root, [str(tmp_path / "run.npz")])
    assert allowed.checked(str(tmp_path / "run.npz")) == tmp_path / "run.npz"
    assert allowed.checked("run.npz") == root / "run.npz"
    with pytest.raises(InputError, match="outside"):
        allowed.checked(str(tmp_path / "run_2.npz"))


def test_nothing_is_opened_or_saved_elsewhere(desk: Desk, recordings: Path) -> None:
    for forged in ("../../etc/passwd", "/etc/hostname"):
        with pytest.raises(InputError, match="outside"):
            desk.open([forged])
        with pytest.raises(InputError, match="outside"):
            desk.open(["run_1"], model=forged)
        with pytest.raises(InputError, match="outside"):
            target(desk, forged, force=True)
    assert target(desk, "model.yaml", force=False) == recordings / "model.yaml"
    with pytest.raises(InputError, match="is a folder"):
        target(desk, "run_1", force=True)
    with pytest.raises(InputError, match="exists already"):
        target(desk, "motion_0.yaml", force=False)


@pytest.mark.parametrize("name", ["../session_1", "session_1/..", "/etc", "session_x", "session_1\n"])
def test_a_session_is_named_by_its_number_alone(desk: Desk, name: str) -> None:
    with pytest.raises(InputError, match="no such session"):
        desk.session(name)


def test_the_loopback_alone_is_listened_to(desk: Desk) -> None:
    server = bind(desk, 0)
    try:
        assert server.socket.getsockname()[0] == "127.0.0.1"
        with pytest.raises(InputError, match="--port"):
            bind(desk, server.server_port)
    finally:
        server.server_close()
