"""HTML pages, parsed: tags that close in order, pictures, and text."""

from html.parser import HTMLParser

EMPTY = {"img", "br", "meta", "path", "use", "rect", "line", "circle", "stop"}


class Checked(HTMLParser):
    """Tags that close in order, pictures, and the text of the page."""

    def __init__(self, page):
        super().__init__()
        self.open, self.images, self.text, self.links, self.ids = [], 0, [], [], []
        self.feed(page)
        assert not self.open

    def handle_starttag(self, tag, attributes):
        self.images += tag in ("img", "svg")
        self.links += [value for name, value in attributes if name in ("src", "href", "xlink:href", "action")]
        self.ids += [value for name, value in attributes if name == "id"]
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.handle_starttag(tag, attributes)
        if tag not in EMPTY:
            self.open.pop()

    def handle_endtag(self, tag):
        if tag not in EMPTY:
            assert self.open.pop() == tag

    def handle_data(self, data):
        self.text.append(data)
