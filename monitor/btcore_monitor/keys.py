"""Keys for encrypted and authenticated connections (ZeroMQ's CURVE): key files, and sockets that use them.

A key pair consists of two files, as with ssh-keygen: FILE with the secret key, which only its owner may read,
and FILE.pub with the public key. A public key is written as 64 hexadecimal digits.
"""

import os
import re
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import zmq
from zmq.utils import z85

from btcore_monitor.errors import MonitorError

_KEY: Final = re.compile(r"[0-9A-Fa-f]{64}")
_SECRET_WORD: Final = "secret"
_MAX_FILE: Final = 1 << 20

_Socket = zmq.Socket[bytes]

_BINARY: Final = getattr(os, "O_BINARY", 0)
"""The flag of Windows for a file whose line ends are not translated."""


class KeyFileError(MonitorError):
    """A key or a key file cannot be used. The message has the file and the reason."""


class RobotKeys:
    """The keys of a robot: its secret key, and the public keys of the clients that may connect.

    Args:
        key_file: The file with the robot's secret key, which `btcore keys` creates.
        allow: The public keys of the clients: each is a key in hexadecimal digits or a file with one key per
            line, such as the `.pub` files of `btcore keys`.

    Raises:
        KeyFileError: A key is invalid, or a file cannot be used.
    """

    def __init__(self, key_file: str | os.PathLike[str], allow: Iterable[str | os.PathLike[str]]) -> None:
        self._secret = _read_secret_key(Path(key_file))
        self.allowed = frozenset(key for place in allow for key in _read_public_keys(place))
        """The public keys of the clients, 32 bytes each."""
        if not self.allowed:
            raise KeyFileError(
                f"no client may connect to a robot with the key {key_file}: allow a public key"
            )

    @property
    def public(self) -> str:
        """The robot's public key."""
        return _derive_public_key(self._secret)

    def secure(self, socket: _Socket) -> None:
        """Require keys at the endpoints to which *socket* is bound after this call.

        The public keys of the clients are checked by a `btcore_monitor.serve.publisher_sockets.Authenticator`
        in the same context. Without it, every client is refused.
        """
        socket.setsockopt(zmq.CURVE_SERVER, 1)
        socket.setsockopt(zmq.CURVE_SECRETKEY, self._secret)
        socket.setsockopt(zmq.ZAP_DOMAIN, b"btcore")
        # Without this option, libzmq would accept every client that knows the robot's public key if there
        # were no authenticator.
        socket.setsockopt(zmq.ZAP_ENFORCE_DOMAIN, 1)


class ClientKeys:
    """The keys of a client: its secret key, and the public key of the robot.

    Args:
        key_file: The file with the client's secret key, which `btcore keys` creates.
        robot: The robot's public key in hexadecimal digits, or the file with this key.

    Raises:
        KeyFileError: A key is invalid, or a file cannot be used.
    """

    def __init__(self, key_file: str | os.PathLike[str], robot: str | os.PathLike[str]) -> None:
        self._secret = _read_secret_key(Path(key_file))
        robots = _read_public_keys(robot)
        if len(robots) != 1:
            raise KeyFileError(f"{robot} has {len(robots)} keys: a robot has one public key")
        self._robot = robots[0]

    @property
    def public(self) -> str:
        """The client's public key."""
        return _derive_public_key(self._secret)

    def secure(self, socket: _Socket) -> None:
        """Use these keys for the connections that *socket* makes after this call."""
        socket.setsockopt(zmq.CURVE_SERVERKEY, self._robot)
        socket.setsockopt(zmq.CURVE_SECRETKEY, self._secret)
        socket.setsockopt(zmq.CURVE_PUBLICKEY, bytes.fromhex(self.public))


def create_keys(path: Path) -> str:
    """Create a key pair: the file *path* and *path* with `.pub` appended. Return the public key.

    Raises:
        KeyFileError: A file exists or cannot be written, or ZeroMQ has no CURVE.
    """
    _check_curve()
    public_path = public_file(path)
    for existing in (path, public_path):
        if os.path.lexists(existing):
            raise KeyFileError(f"{existing} exists and is not overwritten: choose another name")
    public_text, secret_text = zmq.curve_keypair()
    public, secret = z85.decode(public_text).hex(), z85.decode(secret_text).hex()
    _create(path, f"# A secret key of btcore. Do not copy this file.\n{_SECRET_WORD} {secret}\n", 0o600)
    try:
        _create(public_path, f"{public} {path.name}\n", 0o644)
    except KeyFileError:
        path.unlink()
        raise
    return public


def public_file(path: Path) -> Path:
    """Return the path of the public key that belongs to the secret key at *path*."""
    return path.with_name(f"{path.name}.pub")


def _create(path: Path, text: str, mode: int) -> None:
    try:
        # O_EXCL: neither overwrite a file nor follow a link, even if it was created a moment ago.
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY, mode)
        try:
            os.write(descriptor, text.encode())
        finally:
            os.close(descriptor)
    except OSError as error:
        raise KeyFileError(f"{path} cannot be written: {error.strerror or error}") from None


def _read_secret_key(path: Path) -> bytes:
    _check_curve()
    for line in _read_lines(path, secret=True):
        word, _, key = line.partition(" ")
        if word == _SECRET_WORD and _KEY.fullmatch(key.strip()):
            return bytes.fromhex(key)
        if _KEY.match(line):
            raise KeyFileError(f"{path} has a public key, not a secret key: use the file without .pub")
        break
    raise KeyFileError(f"{path} has no secret key: btcore keys FILE creates one")


def _read_public_keys(place: str | os.PathLike[str]) -> list[bytes]:
    if isinstance(place, str) and _KEY.fullmatch(place):
        return [bytes.fromhex(place)]
    path = Path(place)
    if not os.path.lexists(path):
        raise KeyFileError(f"'{place}' is neither a file nor a public key, which has 64 hexadecimal digits")
    keys = []
    for number, line in enumerate(_read_lines(path), 1):
        key, _, _ = line.partition(" ")
        if key == _SECRET_WORD:
            raise KeyFileError(f"{path} has a secret key, not a public key: use {public_file(path)}")
        if not _KEY.fullmatch(key):
            raise KeyFileError(f"{path}: key {number} is not a public key, which has 64 hexadecimal digits")
        keys.append(bytes.fromhex(key))
    if not keys:
        raise KeyFileError(f"{path} has no public key")
    return keys


def _read_lines(path: Path, secret: bool = False) -> list[str]:
    """Return the lines of a key file. Other users must not be able to read a *secret* file."""
    try:
        # O_NONBLOCK: do not wait for the writer of a FIFO.
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | _BINARY)
        try:
            status = os.fstat(descriptor)
            if not stat.S_ISREG(status.st_mode):
                raise KeyFileError(f"{path} is not a regular file")
            mode = stat.S_IMODE(status.st_mode)
            if secret and os.name == "posix" and mode & 0o077:
                raise KeyFileError(
                    f"{path} is not used, because other users can access it (mode {mode:04o}): "
                    f"chmod 600 {path}"
                )
            data = os.read(descriptor, _MAX_FILE + 1)
        finally:
            os.close(descriptor)
    except FileNotFoundError:
        raise KeyFileError(f"there is no file {path}: btcore keys FILE creates a key") from None
    except OSError as error:
        raise KeyFileError(f"{path} cannot be read: {error.strerror or error}") from None
    if len(data) > _MAX_FILE:
        raise KeyFileError(f"{path} is too large for a key file")
    lines = (line.strip() for line in data.decode("utf-8", "replace").splitlines())
    return [line for line in lines if line and not line.startswith("#")]


def _derive_public_key(secret: bytes) -> str:
    return z85.decode(zmq.curve_public(z85.encode(secret))).hex()


def _check_curve() -> None:
    if not zmq.has("curve"):
        raise KeyFileError(
            "this installation of ZeroMQ has no CURVE, which keys need: pip install --force-reinstall pyzmq"
        )
