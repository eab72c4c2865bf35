"""The conductor: phrases played on both cells."""
