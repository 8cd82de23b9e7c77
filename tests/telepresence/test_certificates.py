from __future__ import annotations

import stat
from typing import TYPE_CHECKING

import pytest
from cryptography import x509

from ghal360_robot.errors import GhalError, UsageError
from ghal360_robot.telepresence import certificates

if TYPE_CHECKING:
    from pathlib import Path


def load(path: Path) -> x509.Certificate:
    return x509.load_pem_x509_certificate(path.read_bytes())


def test_a_certificate_names_every_name_and_is_signed_by_the_authority(tmp_path: Path) -> None:
    made = certificates.make(tmp_path / "tls", ("robot.local", "192.168.1.20", "::1"))
    page, authority = load(made.certificate), load(made.authority)
    page.verify_directly_issued_by(authority)
    names = page.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["robot.local"]
    assert [str(ip) for ip in names.get_values_for_type(x509.IPAddress)] == ["192.168.1.20", "::1"]
    assert not page.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    assert (page.not_valid_after_utc - page.not_valid_before_utc).days <= 398


def test_keys_are_for_their_owner_alone(tmp_path: Path) -> None:
    certificates.make(tmp_path, ("robot.local",))
    for name in ("ca.key", "page.key"):
        assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o600


def test_the_authority_stays_and_signs_again(tmp_path: Path) -> None:
    first = certificates.make(tmp_path, ("robot.local",))
    authority = first.authority.read_bytes()
    second = certificates.make(tmp_path, ("other.local",))
    assert (first.new_authority, second.new_authority) == (True, False)
    assert second.authority.read_bytes() == authority
    load(second.certificate).verify_directly_issued_by(load(second.authority))


@pytest.mark.parametrize("name", ["", "a b", "robot_1.local", "x" * 300, "http://robot", "ünicode.local", "*"])
def test_a_name_that_is_none_is_refused_before_anything_is_written(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError):
        certificates.make(tmp_path / "tls", (name,))
    assert not (tmp_path / "tls").exists()


@pytest.mark.parametrize("name", ["ca.crt", "ca.key"])
def test_a_damaged_authority_is_one_sentence(tmp_path: Path, name: str) -> None:
    certificates.make(tmp_path, ("robot.local",))
    (tmp_path / name).write_text("nonsense")
    with pytest.raises(GhalError, match="delete both"):
        certificates.make(tmp_path, ("robot.local",))


def test_this_machine_knows_itself() -> None:
    names = certificates.own_names()
    assert {"localhost", "127.0.0.1", "::1"} <= set(names)
    assert len(set(names)) == len(names)
