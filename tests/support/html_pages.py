"""Parses pages of HTML: tags, attributes, scripts."""

from html.parser import HTMLParser

VOID = {"meta", "link", "br", "input", "hr", "img"}


class Page(HTMLParser):
    """Tags, attributes and scripts of a page; asserts that tags are closed in order."""

    def __init__(self, text):
        super().__init__()
        self.open, self.elements, self.scripts = [], [], {}
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append((tag, dict(attrs)))

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop()[0] == tag

    def handle_data(self, data):
        if self.open and self.open[-1][0] == "script":
            self.scripts[self.open[-1][1].get("id", "")] = data
