"""What the tests of the checker share: a maker of small certificates, a table of falsehoods, a second checker."""
