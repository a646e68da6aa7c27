"""How a page contains a plot."""

from homeward.layout.plots import described


def test_what_a_plot_says_is_escaped() -> None:
    assert (
        described("<svg/>", 'a "b" <c>')
        == '<div role="img" aria-label="a &#34;b&#34; &lt;c&gt;"><svg/></div>'
    )
