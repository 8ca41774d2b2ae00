"""One file has all texts of errors, refusals, notes and findings, to be read and reviewed together."""

from tests.support.texts import FILE, all_texts


def test_the_reviewed_file_has_the_texts_of_the_product() -> None:
    assert FILE.read_text(encoding="utf-8") == all_texts(), "after a review: python -m tests.support.texts"
