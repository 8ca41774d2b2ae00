"""Links between pages lead somewhere, also to their headings, where the files themselves are read.

What the site makes of them `make docs` checks; README and its neighbours are on no site.
"""

import re

import pytest

from tests.docs.pages import ROOT, pages, without_blocks

_LINK = re.compile(r"(?<!\\)\[[^]\n]*\](?:\(([^)\s]+)\))")
_HEADING = re.compile(r"^#{1,6} (.+)$", re.MULTILINE)


def slugs(page: str) -> set[str]:
    """The names of a page's headings, as code forges make them."""
    plain = [re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", heading) for heading in _HEADING.findall(without_blocks(page))]
    return {re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in plain}


@pytest.mark.parametrize("page", pages())
def test_every_link_leads_to_a_file_and_heading_that_are_there(page: str) -> None:
    lost = []
    for target in _LINK.findall(re.sub(r"`[^`\n]*`", "", without_blocks(page))):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, heading = target.partition("#")
        file = (ROOT / page).parent / path if path else ROOT / page
        if not file.exists() or (heading and heading not in slugs(str(file.resolve().relative_to(ROOT)))):
            lost.append(target)
    assert lost == []


def test_links_of_pages_stay_within_the_site() -> None:
    out = [(page, link) for page in pages() if page.startswith("docs/") for link in _LINK.findall(without_blocks(page))]
    docs = ROOT / "docs"
    strays = [
        (page, link)
        for page, link in out
        if not re.match(r"[a-z]+:|#", link)
        and docs not in ((ROOT / page).parent / link.partition("#")[0]).resolve().parents
    ]
    assert strays == []


_SOURCE = re.compile(r"`((?:schemas|commd|bridged|agentd|argosy|tests|benchmarks)/[\w/]+\.py)`")


@pytest.mark.parametrize("page", pages())
def test_every_source_file_that_a_page_names_is_there(page: str) -> None:
    assert [file for file in _SOURCE.findall(without_blocks(page)) if not (ROOT / file).is_file()] == []
