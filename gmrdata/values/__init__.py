"""The values that carry everything, and the records that stages leave."""
