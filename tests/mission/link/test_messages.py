"""The stub of the dialect is up to date."""

import write_message_stub

TEXT = write_message_stub.STUB.read_text(encoding="utf-8")


def test_the_stub_is_what_the_script_writes():
    assert write_message_stub.stub() == TEXT, "run python tools/write_message_stub.py"
