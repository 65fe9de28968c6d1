"""What a reader says of a bad file."""

import pytest


def complaint(read, folder, text, error):
    """The text of the error about ``bad.toml``: one line with its path; without a text there is no file."""
    path = folder / "bad.toml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(error) as caught:
        read(path)
    told = str(caught.value)
    assert str(path) in told
    assert "\n" not in told
    return told
