"""Wheels of message packages: generate the code, compile it, pack it, install it with pip.

The generators are those of ROS 2 and come with rclpy. They are called as ROS 2's CMake files call them, but
without CMake and without C++ structures: Python needs the C structures, their conversion from and to Python,
and the type supports for C. The libraries have the names that a CMake build gives them.

The version of a wheel ends in a hash of everything that it was built from, so that an installed wheel shows
whether it is up to date.
"""

import base64
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Final

from btcore.extras import install_command
from btcore.output_files import write_file
from btcore.signals import NEW_PROCESS_GROUP
from btcore_ros2.errors import RosError
from btcore_ros2.message_packages.definitions import KINDS, MessagePackage

GENERATORS: Final = (
    "rosidl_adapter",
    "rosidl_generator_c",
    "rosidl_generator_py",
    "rosidl_generator_type_description",
    "rosidl_typesupport_c",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_typesupport_introspection_c",
)
MARK: Final = "+btcore."
"""What distinguishes the versions of wheels that btcore built."""

_OPTIMIZATION: Final = "-O1"
"""-O0 compiles nav2_msgs 3 s faster, and -O2 takes 6 s more."""
_GROUP: Final = 16
"""How many source files of a folder the compiler reads at once. It reads the headers once for each group."""
_IMPLIED: Final = ("action_msgs", "builtin_interfaces", "service_msgs", "unique_identifier_msgs")
"""The packages that the messages of services and actions contain without naming them."""
_TYPE_SUPPORTS: Final = ("rosidl_typesupport_introspection_c", "rosidl_typesupport_fastrtps_c")
_LIBRARIES: Final = ("rosidl_generator_c", *_TYPE_SUPPORTS, "rosidl_typesupport_c", "rosidl_generator_py")
"""The libraries of a message package, each linked with those before it. ROS 2 finds them by these names."""
_RUNTIME: Final = (
    "fastcdr",
    "rcutils",
    "rosidl_runtime_c",
    "rosidl_typesupport_c",
    "rosidl_typesupport_fastrtps_c",
    "rosidl_typesupport_fastrtps_cpp",
    "rosidl_typesupport_introspection_c",
)


PROCESSES: Final = os.cpu_count() or 1
_POLL_S: Final = 0.02
_SHOWN_LINES: Final = 12
"""How many lines of a command's output an error message contains."""


def run_jobs(commands: Sequence[Sequence[str]], folder: Path, done: Callable[[], None]) -> None:
    """Run *commands*, as many at a time as the machine has cores. All of them end with this function.

    Args:
        commands: The commands. None of them needs the result of another.
        folder: The folder in which they run, and for the files with their output.
        done: Called after each command.

    Raises:
        RosError: A command failed or cannot be started. The message contains the first lines of its output.
    """
    waiting = list(reversed(commands))
    running: list[tuple[subprocess.Popen[bytes], Path]] = []
    try:
        while waiting or running:
            while waiting and len(running) < PROCESSES:
                command = waiting.pop()
                log = folder / f"{len(waiting)}.log"
                with log.open("wb") as output:
                    try:
                        process = subprocess.Popen(
                            command, cwd=folder, stdout=output, stderr=subprocess.STDOUT
                        )
                    except OSError as error:
                        raise RosError(f"{command[0]} cannot be started: {error}") from error
                running.append((process, log))
            for entry in tuple(running):
                process, log = entry
                try:
                    code = process.wait(_POLL_S)
                except subprocess.TimeoutExpired:
                    continue
                running.remove(entry)
                if code != 0:
                    raise RosError(_failure(process.args, code, log))
                done()
    finally:
        for process, _ in running:
            process.kill()
            process.wait()


def _failure(command: object, code: int, log: Path) -> str:
    lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
    # A compiler prints its first error first, and a Python program its exception last.
    shown = lines[-_SHOWN_LINES:] if "Traceback (most recent call last):" in lines else lines[:_SHOWN_LINES]
    name = Path(command[0]).name if isinstance(command, list | tuple) else str(command)
    return "\n".join([f"{name} failed with exit code {code}:", *(f"  {line}" for line in shown)])


def installed_messages(prefix: Path) -> set[tuple[str, str]]:
    """Return the messages that are installed below *prefix*, as `(package, name)`."""
    return {(path.parts[-3], path.stem) for path in prefix.glob("share/*/msg/*.idl")}


def missing_generators() -> list[str]:
    """Return what of ROS 2 is missing to build wheels: a sentence each, with the command that installs it."""
    missing = []
    generators = sysconfig.get_path("purelib")
    absent = [name for name in GENERATORS if not Path(generators, name).is_dir()]
    if absent:
        missing.append(
            f"ROS 2's generators are not installed ({', '.join(absent)}): {install_command('rclpy')}"
        )
    if not (Path(sys.prefix) / "include" / "rosidl_runtime_c").is_dir():
        missing.append(f"{sys.prefix} does not contain ROS 2's headers: {install_command('rclpy')}")
    return missing


def missing_compilers() -> list[str]:
    """Return what of the system is missing to build wheels, like `missing_generators`."""
    missing = []
    for name, package in ((_compiler("CC", "cc"), "gcc"), (_compiler("CXX", "c++"), "g++")):
        if shutil.which(name[0]) is None:
            missing.append(f"the compiler '{name[0]}' is not installed: sudo apt install {package}")
    if not Path(sysconfig.get_path("include"), "Python.h").exists():
        headers = f"python{sys.version_info.major}.{sys.version_info.minor}-dev"
        missing.append(f"Python.h of this Python is not installed: sudo apt install {headers}")
    return missing


def _compiler(variable: str, default: str) -> list[str]:
    return os.environ.get(variable, default).split() or [default]


def distribution(package: str) -> str:
    """Return the name of the wheel of *package*. The wheels on PyPI are named alike."""
    return f"ros-{package.replace('_', '-')}"


def installed_version(package: str) -> str | None:
    """Return the version of the installed wheel of *package*, or None."""
    try:
        return version(distribution(package))
    except PackageNotFoundError:
        return None


def wheel_version(package: MessagePackage, needed: Mapping[str, str]) -> str:
    """Return the version of the wheel of *package*, with a hash of everything that it is built from.

    Args:
        needed: The versions of the packages that it needs and that are built with it.
    """
    sources = [
        sysconfig.get_config_var("SOABI"),
        Path(__file__).read_text(encoding="utf-8"),
        *(f"{name} {installed_version(name)}" for name in GENERATORS),
        *(f"{name} {needed.get(name) or installed_version(name)}" for name in sorted(package.needs)),
        *(f"{interface.kind}/{interface.name}\n{interface.text}" for interface in package.interfaces),
    ]
    digest = hashlib.sha256(json.dumps(sources).encode()).hexdigest()[:12]
    release = re.match(r"[0-9]+(\.[0-9]+)*", package.version)
    return f"{release[0] if release else '0'}{MARK}{digest}"


def wheel_name(package: MessagePackage, wheel: str) -> str:
    """Return the file name of the wheel of *package* for this machine and Python; *wheel* is its version."""
    return f"{distribution(package.name).replace('-', '_')}-{wheel}-{_tag()}.whl"


def _tag() -> str:
    """Return the tag of the wheels that this Python builds."""
    python = f"cp{sys.version_info.major}{sys.version_info.minor}"
    return f"{python}-{python}-{re.sub(r'[-.]', '_', sysconfig.get_platform())}"


def count_jobs(package: MessagePackage) -> int:
    """Return how often `build_and_install` calls its *done*."""
    return 7 + len(_groups(package)) * 6 + 1 + len(_LIBRARIES) + 1 + 1


def build_and_install(
    package: MessagePackage, wheel: str, done: Callable[[], None], kept: Path | None = None
) -> None:
    """Build the wheel of *package* in a temporary folder and install it.

    Args:
        package: The package; the packages that it needs must be installed.
        wheel: Its `wheel_version`.
        done: Called after each step; see `count_jobs`.
        kept: A folder into which the wheel is copied.

    Raises:
        RosError: A generator, a compiler or pip failed, or *kept* cannot be written.
    """
    with tempfile.TemporaryDirectory(prefix="btcore-messages-") as temporary:
        built = build_wheel(package, wheel, Path(temporary), done)
        if kept is not None:
            try:
                kept.mkdir(parents=True, exist_ok=True)
                write_file(kept / built.name, built.read_bytes())
            except OSError as error:
                raise RosError(f"{kept}: {error.strerror or error}") from error
        install_wheel(built)
        done()


def build_wheel(package: MessagePackage, wheel: str, folder: Path, done: Callable[[], None]) -> Path:
    """Build the wheel of *package* in an empty *folder*, and return its path; see `build_and_install`."""
    build = Build(package, folder.resolve(), done)
    build.describe()
    build.generate()
    build.compile()
    return build.pack(wheel)


def install_wheel(wheel: Path) -> None:
    """Install a wheel with pip, in place of its other versions.

    pip runs in a process of its own that Ctrl-C does not reach, so that the package is installed completely
    or not at all.

    Raises:
        RosError: pip failed.
    """
    command = [sys.executable, "-m", "pip", "install", "--no-index", "--no-deps", "--force-reinstall"]
    quiet = ["--quiet", "--disable-pip-version-check", "--root-user-action=ignore"]
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(
            [*command, *quiet, str(wheel)],
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            creationflags=NEW_PROCESS_GROUP,
        )
        try:
            code = process.wait()
        except BaseException:
            process.wait()
            raise
        log.seek(0)
        output = log.read().decode(errors="replace").strip()
    if code != 0:
        raise RosError(f"pip failed with exit code {code}:\n{output}")


class Build:
    """The folder of a build.

    Args:
        folder: An empty folder.
        done: Called after each step.
    """

    def __init__(self, package: MessagePackage, folder: Path, done: Callable[[], None]) -> None:
        self.package = package
        self.name = package.name
        self.folder = folder
        self.done = done
        self.prefix = Path(sys.prefix)
        self.share = folder / "share" / self.name
        self.headers = folder / "include" / self.name / self.name
        self.python = folder / "python" / self.name
        self.introspection = folder / "introspection" / self.name  # its files have the same names as others
        self.libraries = folder / "lib"
        self.extension = self.python / f"{self.name}_s__rosidl_typesupport_c.so"

    def _run(self, *commands: Sequence[str]) -> None:
        run_jobs(commands, self.folder, self.done)

    def describe(self) -> None:
        """Write the definitions as .idl files, and their type descriptions with type hashes."""
        for interface in self.package.interfaces:
            file = self.share / interface.kind / f"{interface.name}.{interface.kind}"
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(interface.text, encoding="utf-8", newline="\n")
        tuples = self.folder / "definitions.json"
        files = [
            f"{self.share}:{interface.kind}/{interface.name}.{interface.kind}"
            for interface in self.package.interfaces
        ]
        tuples.write_text(json.dumps({"non_idl_tuples": files}), encoding="utf-8", newline="\n")
        adapter = [sys.executable, "-m", "rosidl_adapter", "--package-name", self.name]
        outputs = ["--output-dir", str(self.share), "--output-file", str(self.folder / "idl.txt")]
        self._run([*adapter, "--arguments-file", str(tuples), *outputs])
        shares = (self.prefix / "share", self.share.parent)  # of a package in both, the second is used
        described = [path for share in shares for path in sorted(share.iterdir()) if (path / "msg").is_dir()]
        self._run(
            self._generator(
                "rosidl_generator_type_description",
                self.share,
                include_paths=[f"{path.name}:{path}" for path in described],
            )
        )

    def generate(self) -> None:
        """Write the sources in C, C++ and Python."""
        descriptions = [
            f"{interface.kind}/{interface.name}.idl:{self.share / interface.kind / interface.name}.json"
            for interface in self.package.interfaces
        ]
        impl = "rosidl_typesupport_c"
        self._run(
            [*self._generator("rosidl_generator_py", self.python), "--typesupport-impls", impl],
            self._generator(
                "rosidl_generator_c",
                self.headers,
                type_description_tuples=descriptions,
                ros_interface_files=[
                    str(self.share / interface.kind / f"{interface.name}.{interface.kind}")
                    for interface in self.package.interfaces
                ],
            ),
            self._generator("rosidl_typesupport_fastrtps_c", self.headers),
            self._generator("rosidl_typesupport_introspection_c", self.introspection),
            [*self._generator(impl, self.headers), "--typesupports", *_TYPE_SUPPORTS],
        )
        (self.python / "__init__.py").touch()
        for generator in ("rosidl_generator_c", *_TYPE_SUPPORTS):
            name = f"{generator}__visibility_control.h"
            text = (self.prefix / "share" / generator / "resource" / f"{name}.in").read_text(encoding="utf-8")
            text = text.replace("@PROJECT_NAME_UPPER@", self.name.upper()).replace(
                "@PROJECT_NAME@", self.name
            )
            (self.headers / "msg").mkdir(exist_ok=True)
            (self.headers / "msg" / name).write_text(text, encoding="utf-8", newline="\n")

    def _generator(self, name: str, output: Path, **more: Sequence[str]) -> list[str]:
        """Return the command that runs the generator *name*."""
        output.mkdir(parents=True, exist_ok=True)
        arguments = {
            "package_name": self.name,
            "output_dir": str(output),
            "template_dir": str(self.prefix / "share" / name / "resource"),
            "idl_tuples": [
                f"{self.share}:{interface.kind}/{interface.name}.idl" for interface in self.package.interfaces
            ],
            "target_dependencies": [],
            **more,
        }
        file = self.folder / f"{name}.json"
        file.write_text(json.dumps(arguments), encoding="utf-8", newline="\n")
        program = str(self.prefix / "lib" / name / name)
        return [sys.executable, program, "--generator-arguments-file", str(file)]

    def compile(self) -> None:
        """Compile the library of the package, and Python's module for it."""
        import numpy

        roots = [path for path in sorted((self.prefix / "include").iterdir()) if path.is_dir()]
        folders = [
            self.headers.parent,
            self.introspection.parent,
            self.python.parent,
            *roots,
            self.prefix / "include",
            Path(sysconfig.get_path("include")),
            Path(numpy.get_include()),
        ]
        options = [_OPTIMIZATION, "-fPIC", "-w", *(f"-I{folder}" for folder in folders), "-c"]
        c, cpp = _compiler("CC", "cc"), [*_compiler("CXX", "c++"), "-std=c++17"]
        commands = []
        objects: dict[str, list[Path]] = {library: [] for library in _LIBRARIES}
        for number, (kind, stems) in enumerate(_groups(self.package)):
            detail = self.headers / kind / "detail"
            # Each description has static names of its own, and needs few headers.
            descriptions = [str(detail / f"{stem}__description.c") for stem in stems]
            target = self.folder / f"{number}_descriptions"
            target.mkdir()
            objects["rosidl_generator_c"] += [target / f"{stem}__description.o" for stem in stems]
            commands.append(["env", "-C", str(target), *c, *options, *descriptions])
            sources = {
                "rosidl_generator_c": (
                    ".c",
                    [
                        detail / f"{stem}__{part}.c"
                        for stem in stems
                        for part in ("functions", "type_support")
                    ],
                ),
                "rosidl_typesupport_introspection_c": (
                    ".c",
                    [self.introspection / kind / "detail" / f"{stem}__type_support.c" for stem in stems],
                ),
                "rosidl_typesupport_fastrtps_c": (
                    ".cpp",
                    [detail / f"{stem}__type_support_c.cpp" for stem in stems],
                ),
                "rosidl_typesupport_c": (
                    ".cpp",
                    [self.headers / kind / f"{stem}__type_support.cpp" for stem in stems],
                ),
                "rosidl_generator_py": (".c", [self.python / kind / f"_{stem}_s.c" for stem in stems]),
            }
            for library, (suffix, files) in sources.items():
                source = self.folder / f"{number}_{library}{suffix}"
                text = "".join(f'#include "{file}"\n' for file in files)
                source.write_text(text, encoding="utf-8", newline="\n")
                objects[library].append(source.with_suffix(".o"))
                compiler = cpp if suffix == ".cpp" else c
                commands.append([*compiler, *options, str(source), "-o", str(objects[library][-1])])
        entry = self.python / f"_{self.name}_s.ep.rosidl_typesupport_c.c"
        module = self.folder / "module.o"
        commands.append([*c, *options, str(entry), "-o", str(module)])
        # The C++ files take longest.
        self._run(*sorted(commands, key=lambda command: command[0] != cpp[0]))
        self.libraries.mkdir()
        libraries = self.prefix / "lib"
        runtime = [str(libraries / f"lib{name}.so") for name in _RUNTIME]
        shared = [*cpp, "-shared", "-Wl,--as-needed"]
        built: list[str] = []
        for library in _LIBRARIES:
            path = self.libraries / f"lib{self.name}__{library}.so"
            needed = [
                str(file)
                for package in sorted({*self.package.needs, *_IMPLIED})
                if (file := libraries / f"lib{package}__{library}.so").exists()
            ]
            name = f"-Wl,-soname,{path.name}"  # by which it is found where it is installed
            inputs = [*map(str, objects[library]), *built, *needed, *runtime]
            self._run([*shared, name, "-o", str(path), *inputs])
            built.append(str(path))
        self._run([*shared, "-o", str(self.extension), str(module), *built])

    def pack(self, wheel: str) -> Path:
        """Write the wheel of the version *wheel*, and return its path."""
        distributed = distribution(self.name)
        stem = f"{distributed.replace('-', '_')}-{wheel}"
        tag = _tag()
        data = f"{stem}.data/data"
        contents: dict[str, bytes] = {
            f"{data}/share/ament_index/resource_index/packages/{self.name}": b"",
            f"{data}/share/ament_index/resource_index/rosidl_interfaces/{self.name}": "\n".join(
                f"{interface.kind}/{interface.name}.{suffix}"
                for interface in self.package.interfaces
                for suffix in ("idl", interface.kind)
            ).encode(),
        }
        for root, parent, suffixes in (
            (self.share, f"{data}/share/{self.name}", (".idl", ".json", *(f".{kind}" for kind in KINDS))),
            (self.headers, f"{data}/include/{self.name}/{self.name}", (".h",)),
            (self.introspection, f"{data}/include/{self.name}/{self.name}", (".h",)),
            (self.libraries, f"{data}/lib", (".so",)),
            (self.python, self.name, (".py", ".so")),
        ):
            for path in sorted(root.rglob("*")):
                if path.suffix in suffixes:
                    contents[f"{parent}/{path.relative_to(root).as_posix()}"] = path.read_bytes()
        manifest = self.package.folder / "package.xml"
        if manifest.exists():
            contents[f"{data}/share/{self.name}/package.xml"] = manifest.read_bytes()
        metadata = f"Metadata-Version: 2.1\nName: {distributed}\nVersion: {wheel}\n"
        contents[f"{stem}.dist-info/METADATA"] = metadata.encode()
        contents[f"{stem}.dist-info/WHEEL"] = (
            f"Wheel-Version: 1.0\nGenerator: btcore\nRoot-Is-Purelib: false\nTag: {tag}\n".encode()
        )
        contents[f"{stem}.dist-info/RECORD"] = _record(contents, f"{stem}.dist-info/RECORD")
        path = self.folder / wheel_name(self.package, wheel)
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in contents.items():
                archive.writestr(name, content)
        return path


def _record(contents: Mapping[str, bytes], own: str) -> bytes:
    """Return the list of a wheel's files with their hashes; *own* is the list's own name."""
    lines = []
    for name, content in contents.items():
        digest = base64.urlsafe_b64encode(hashlib.sha256(content).digest()).rstrip(b"=").decode()
        lines.append(f"{name},sha256={digest},{len(content)}\n")
    return "".join([*lines, f"{own},,\n"]).encode()


def _groups(package: MessagePackage) -> list[tuple[str, Sequence[str]]]:
    """Return the kind and the stems of the source files of each group that is compiled at once.

    The files of a folder can be compiled together, because their static names contain the interface's name.
    """
    groups: list[tuple[str, Sequence[str]]] = []
    for kind in KINDS:
        stems = [_snake_case(interface.name) for interface in package.interfaces if interface.kind == kind]
        groups += [(kind, stems[first : first + _GROUP]) for first in range(0, len(stems), _GROUP)]
    return groups


def _snake_case(name: str) -> str:
    """Return a name as the generators write it in names of files: `TF2Error` → `tf2_error`."""
    name = re.sub(r"(.)([A-Z][a-z]+)", r"\1_\2", name)
    return re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", name).lower()
