"""A link that a code host shows by its file's name has the page's title in the site."""

from docsite.labels import with_titles

TITLES = {"index.md": "Home", "methods/ssc.md": "SSC"}


def test_a_file_name_becomes_the_title_and_the_link_stays():
    assert (
        with_titles("([ssc.md](ssc.md#use))", "methods/rinet.md", TITLES) == "([SSC](ssc.md#use))"
    )
    assert (
        with_titles("[docs/index.md](../index.md)", "methods/a.md", TITLES) == "[Home](../index.md)"
    )


def test_words_and_pages_that_are_unknown_stay():
    for text in ("[why](methods/ssc.md)", "[a.md](a.md)", "[ssc.md](https://a.org/ssc.md)"):
        assert with_titles(text, "index.md", TITLES) == text
