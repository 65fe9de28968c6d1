"""What a reader says of a bad file."""

import pytest


def complaint(read, path, text, error):
    """The text of the error, which is one line with the name of the file; without a text there is no file."""
    if text is not None:
        path.write_text(text)
    with pytest.raises(error) as caught:
        read(path)
    told = str(caught.value)
    assert path.name in told
    assert "\n" not in told
    return told
