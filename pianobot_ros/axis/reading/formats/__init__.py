"""A file of any format as tables: named columns of one length."""
