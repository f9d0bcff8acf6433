"""The documentation site: pages made from the code, links between documents and pages, checks of what was built."""
