"""Key files: created once, readable by their owner only, and refused with a message if they are wrong."""

import os
import stat
from pathlib import Path

import pytest

from btcore_monitor import keys
from btcore_monitor.keys import ClientKeys, KeyFileError, RobotKeys, create_keys

PUBLIC = "0123456789abcdef" * 4


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    path = tmp_path / "desk"
    create_keys(path)
    return path


def test_a_key_pair_is_readable_by_its_owner_only(tmp_path: Path) -> None:
    path = tmp_path / "desk"
    before = os.umask(0)
    try:
        public = create_keys(path)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert (tmp_path / "desk.pub").read_text() == f"{public} desk\n"
    assert len(bytes.fromhex(public)) == 32
    assert public not in path.read_text()
    assert RobotKeys(path, [public]).public == ClientKeys(path, public).public == public


@pytest.mark.parametrize("name", ["desk", "desk.pub"])
def test_existing_files_are_not_overwritten(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("precious")
    with pytest.raises(KeyFileError, match=f"{name} exists and is not overwritten"):
        create_keys(tmp_path / "desk")
    assert [path.name for path in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text() == "precious"


def test_a_link_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "desk").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(KeyFileError, match="not overwritten"):
        create_keys(tmp_path / "desk")
    assert not (tmp_path / "elsewhere").exists()


def test_a_folder_that_does_not_exist_is_reported(tmp_path: Path) -> None:
    with pytest.raises(KeyFileError, match=r"cannot be written: No such file or directory"):
        create_keys(tmp_path / "no" / "desk")


def test_a_file_may_hold_several_keys_with_comments(tmp_path: Path, secret: Path) -> None:
    path = tmp_path / "clients"
    other = create_keys(tmp_path / "laptop")
    path.write_text(f"# desks\n\n{PUBLIC} desk of Ann\n  {other.upper()}\n")
    allowed = RobotKeys(secret, [path, str(tmp_path / "laptop.pub")]).allowed
    assert allowed == {bytes.fromhex(PUBLIC), bytes.fromhex(other)}


def wrong_secrets(folder: Path) -> dict[str, tuple[Path, str]]:
    return {
        "missing": (folder / "none", "there is no file .*none: btcore keys FILE creates a key"),
        "a folder": (folder, "is not a regular file"),
        "a pipe": (folder / "pipe", "is not a regular file"),
        "public": (folder / "desk.pub", "has a public key, not a secret key: use the file without .pub"),
        "text": (folder / "text", "has no secret key: btcore keys FILE creates one"),
        "short": (folder / "short", "has no secret key"),
        "binary": (folder / "binary", "has no secret key"),
        "large": (folder / "large", "is too large for a key file"),
        "open": (folder / "open", r"other users can access it \(mode 0640\): chmod 600 .*open"),
    }


@pytest.mark.parametrize(
    "kind", ["missing", "a folder", "a pipe", "public", "text", "short", "binary", "large", "open"]
)
def test_a_wrong_secret_key_is_refused(tmp_path: Path, secret: Path, kind: str) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    (tmp_path / "desk.pub").chmod(0o600)
    for name, data in {
        "text": b"hello",
        "short": b"secret 0123",
        "binary": bytes(range(256)),
        "large": bytes(2 << 20),
        "open": secret.read_bytes(),
    }.items():
        (tmp_path / name).write_bytes(data)
        (tmp_path / name).chmod(0o640 if name == "open" else 0o600)
    path, message = wrong_secrets(tmp_path)[kind]
    for read in (lambda: RobotKeys(path, [PUBLIC]), lambda: ClientKeys(path, PUBLIC)):
        with pytest.raises(KeyFileError, match=message):
            read()


def test_a_wrong_public_key_is_refused(tmp_path: Path, secret: Path) -> None:
    (tmp_path / "none.pub").write_text("# nothing\n")
    (tmp_path / "odd.pub").write_text(f"{PUBLIC}\nssh-ed25519 AAAA\n")
    for place, message in {
        "0123": "'0123' is neither a file nor a public key, which has 64 hexadecimal digits",
        str(secret): "has a secret key, not a public key: use .*desk.pub",
        str(tmp_path / "none.pub"): "has no public key",
        str(tmp_path / "odd.pub"): "key 2 is not a public key",
    }.items():
        with pytest.raises(KeyFileError, match=message):
            RobotKeys(secret, [PUBLIC, place])
        with pytest.raises(KeyFileError, match=message):
            ClientKeys(secret, place)


def test_robot_allows_at_least_one_client_and_client_knows_one_robot(tmp_path: Path, secret: Path) -> None:
    (tmp_path / "two").write_text(f"{PUBLIC}\n{PUBLIC[::-1]}\n")
    with pytest.raises(KeyFileError, match="no client may connect"):
        RobotKeys(secret, [])
    with pytest.raises(KeyFileError, match="two has 2 keys: a robot has one public key"):
        ClientKeys(secret, tmp_path / "two")


def test_zeromq_without_curve_is_reported(
    tmp_path: Path, secret: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keys.zmq, "has", lambda name: name != "curve")
    for use in (lambda: create_keys(tmp_path / "new"), lambda: RobotKeys(secret, [PUBLIC])):
        with pytest.raises(KeyFileError, match="has no CURVE, which keys need: pip install"):
            use()
    assert not (tmp_path / "new").exists()


def test_the_secret_key_is_private_even_with_a_permissive_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        create_keys(tmp_path / "desk")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "desk").stat().st_mode) == 0o600
