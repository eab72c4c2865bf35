"""What `make` installs with: pip's configuration, handed on to uv."""

from __future__ import annotations

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tools"))

from install import told

ANY = ["--index-strategy", "unsafe-best-match"]


def test_without_a_configuration_nothing_is_told() -> None:
    assert told("") == (ANY, {})


def test_places_and_certificates_are_told_and_the_environment_counts_most() -> None:
    flags, variables = told(
        ":env:.find-links='/wheels'\n"
        "global.cert='/certificates.pem'\n"
        "global.extra-index-url='file:///one file:///two'\n"
        "global.find-links='/elsewhere'\n"
        "global.no-index='true'\n"
        "global.timeout='180'\n"
        'install.constraint="/it\'s"\n'
    )
    indexes = ["--extra-index-url", "file:///one", "--extra-index-url", "file:///two"]
    others = ["--find-links", "/wheels", "--constraint", "/it's", "--no-index"]
    assert flags == ANY + indexes + others
    assert variables == {"SSL_CERT_FILE": "/certificates.pem"}


def test_a_proxy_is_told_by_variables() -> None:
    assert told("global.proxy='proxy:80'\n")[1] == {
        "HTTP_PROXY": "proxy:80",
        "HTTPS_PROXY": "proxy:80",
    }
