"""Flight records: readers of the field's formats, and one form for all of them."""
