"""Whether a session can be used: its files, its scans, its poses, and both together."""

from collections.abc import Hashable
from hashlib import sha256

from deepring.data.inspection.finding import Finding
from deepring.data.inspection.poses import MOST_WITHOUT_POSE, overlay_findings, pose_findings
from deepring.data.inspection.session_scans import (
    measure_scans,
    measured_findings,
    repeated_findings,
)
from deepring.data.left_out import MOST
from deepring.data.session import Session
from deepring.data.spacing import sample_of
from deepring.errors import DataError

#: Scans that a quick inspection reads, evenly spread over the drive.
SAMPLE = 12


#: Findings by what was inspected: training and evaluation open the same sessions several times.
_known: dict[tuple[Hashable, ...], list[Finding]] = {}


def inspect(session: Session, ground_z: float | None) -> list[Finding]:
    """Doubts about a session, from a sample of its scans and all its poses: about a second.

    ``ground_z`` is z of the ground in the scans' frame, metres; None if it is not known. Scans
    that cannot be read are left to those who need them, and files that are left out are doubted
    only if they are too many, since every command says them. A session is inspected once in a
    process, and again if files of the sample or poses have changed.
    """
    indices = sample_of(len(session), SAMPLE)
    key = (ground_z, *_identity(session, indices))
    if key not in _known:
        _known[key] = _inspect(session, indices, ground_z)
    return list(_known[key])


def _inspect(session: Session, indices: list[int], ground_z: float | None) -> list[Finding]:
    scans = measured_findings(session, measure_scans(session, indices), ground_z)
    return [
        *(finding for finding in file_findings(session) if finding.unusable),
        *scans,
        *repeated_findings(session, indices),
        *pose_findings(session),
        # Points that are none say nothing about poses.
        *([] if any(finding.unusable for finding in scans) else overlay_findings(session)),
    ]


def _identity(session: Session, indices: list[int]) -> tuple[Hashable, ...]:
    """What a session's findings depend on, as far as it can be told without reading scans."""
    files = []
    for index in indices:
        try:
            state = session.files[index].stat()
            files.append((str(session.files[index]), state.st_size, state.st_mtime_ns))
        except OSError:
            files.append((str(session.files[index]), 0, 0))
    stamps = b"" if session.stamps is None else session.stamps.tobytes()
    poses = sha256(session.poses.tobytes() + stamps).digest()
    return (session.name, session.decoding, session.skipped, *files, poses)


def expect_usable(session: Session, ground_z: float | None) -> list[Finding]:
    """Inspect a session (`inspect`), and return the doubts.

    Raises DataError, with what was found and what to change, if the session is unusable.
    """
    findings = inspect(session, ground_z)
    unusable = [str(finding) for finding in findings if finding.unusable]
    if unusable:
        raise DataError(f"session {session.name} cannot be used: {'. '.join(unusable)}")
    return findings


def file_findings(session: Session, unreadable: tuple[str, ...] = ()) -> list[Finding]:
    """Scans that are left out: broken, ``unreadable`` when decoded, or without a pose.

    As everywhere, the session is unusable if more than `MOST` of the files, and more than one, are
    broken.
    """
    broken = session.skipped.broken + unreadable
    total = len(session) + len(session.skipped.broken)
    findings = []
    if broken:
        found = f"{len(broken)} of {total} cannot be read, the first {broken[0]}"
        many = len(broken) > max(1, MOST * total) or len(broken) == total
        again = "fetch or unpack them again"
        advice = f"check how they were written, or {again}" if many else f"left out: {again}"
        findings.append(Finding("files", found, advice, unusable=many))
    without = session.skipped.without_pose
    if 0 < without <= MOST_WITHOUT_POSE * (len(session) + without):  # more are found with the poses
        found = f"{without} of {len(session) + without} scans have no pose within the tolerance"
        advice = "they are left out: expected where poses begin late or end early"
        findings.append(Finding("files", found, advice))
    return findings
