"""Who may talk to the workbench, and what it may be told to touch."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

from robot_ident.errors import InputError
from robot_ident.workbench.allowed_paths import Allowed
from robot_ident.workbench.controller import Desk, target
from robot_ident.workbench.server import bind, make_app

TOKEN = "what-was-printed"


@pytest.fixture
def stranger(desk: Desk) -> Any:
    """Someone on this machine who was not told the token."""
    return make_app(desk, 8050, TOKEN).server.test_client(use_cookies=False)


@pytest.fixture
def shown(stranger: Any) -> dict[str, str]:
    """What the browser of someone who opened the printed address sends from then on."""
    answer = stranger.get(f"/?token={TOKEN}", headers={"Host": "127.0.0.1:8050"})
    return {"Cookie": answer.headers["Set-Cookie"].partition(";")[0]}


@pytest.fixture
def known(shown: dict[str, str]) -> dict[str, str]:
    return {"Host": "127.0.0.1:8050", **shown}


def test_only_this_machines_names_are_answered(stranger: Any, shown: dict[str, str]) -> None:
    for name in ("127.0.0.1:8050", "localhost:8050", "[::1]:8050"):
        assert stranger.get("/", headers={**shown, "Host": name}).status_code == 200
    for name in ("evil.example", "evil.example:8050", "127.0.0.1:80", "127.0.0.1.evil.example:8050", "localhost"):
        assert stranger.get("/", headers={**shown, "Host": name}).status_code == 403


def test_nobody_is_answered_without_the_token(stranger: Any) -> None:
    address = {"Host": "127.0.0.1:8050"}
    asked = [
        ("GET", path)
        for path in ("/", "/session_1", "/_dash-layout", "/_dash-dependencies", "/_now/session_1", "/_favicon.ico")
    ]
    asked += [("GET", "/assets/workbench.js"), ("POST", "/_dash-update-component"), ("OPTIONS", "/"), ("GET", "/no")]
    for method, path in asked:
        for more, query in (
            ({}, ""),
            ({}, "?token="),
            ({}, f"?token={TOKEN[:-1]}"),
            ({}, "?token=%C3%A9%F0%9F%98%80"),
            ({"Cookie": "robot_ident_workbench_8050="}, ""),
            ({"Cookie": "robot_ident_workbench_8050=guessed"}, ""),
            ({"Cookie": f"robot_ident_workbench_8051={TOKEN}"}, ""),
        ):
            answer = stranger.open(path + query, method=method, headers={**address, **more})
            assert answer.status_code == 403, (method, path, query)
            assert "Set-Cookie" not in answer.headers
            assert method == "HEAD" or "open the URL with “?token=” that robot_ident workbench printed" in answer.text


def test_the_printed_address_leads_to_the_page_and_leaves_a_cookie(stranger: Any) -> None:
    address = {"Host": "127.0.0.1:8050"}
    answer = stranger.get(f"/session_1?token={TOKEN}", headers=address)
    assert (answer.status_code, answer.headers["Location"]) == (303, "/session_1")
    cookie = answer.headers["Set-Cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=Strict" in cookie
    assert "8050" in cookie.partition("=")[0], "two workbenches of one user keep theirs apart"
    assert answer.headers["Cache-Control"] == "no-store"
    for path in ("/", "/_dash-layout", "/assets/workbench.js"):
        known = {**address, "Cookie": cookie.partition(";")[0]}
        assert stranger.get(path, headers=known).status_code == 200
    for path in ("//evil.example/", "/%5Cevil.example/", "///evil.example"):
        led = stranger.get(f"{path}?token={TOKEN}", headers=address).headers.get("Location", "/")
        assert re.fullmatch(r"/(?![/\\]).*|/", led), f"{path} leads to {led}"


def test_pages_of_other_sites_are_refused(stranger: Any, known: dict[str, str]) -> None:
    assert stranger.get("/_dash-layout", headers={**known, "Origin": "http://127.0.0.1:8050"}).status_code == 200
    for more in (
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
        {"Origin": "http://localhost:3000"},
        {"Sec-Fetch-Site": "cross-site"},
        {"Sec-Fetch-Site": "same-site"},
    ):
        assert stranger.post("/_dash-update-component", headers={**known, **more}, json={}).status_code == 403


def test_a_page_may_load_nothing_from_elsewhere(stranger: Any, known: dict[str, str]) -> None:
    answer = stranger.get("/", headers=known)
    assert "default-src 'self'" in answer.headers["Content-Security-Policy"]
    assert "https://" not in answer.text
    assert 'src="//' not in answer.text


def test_assets_lead_to_no_other_file(stranger: Any, known: dict[str, str]) -> None:
    for path in ("/assets/../app.py", "/assets/%2e%2e/app.py", "/assets/..%2f..%2ferrors.py", "/assets//etc/passwd"):
        answer = stranger.get(path, headers=known)
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
    server = bind(desk, 0, TOKEN)
    try:
        assert server.socket.getsockname()[0] == "127.0.0.1"
        with pytest.raises(InputError, match="--port"):
            bind(desk, server.server_port, TOKEN)
    finally:
        server.server_close()
