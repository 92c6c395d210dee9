"""The kinds of record, by who has something to say; `logs.records` offers them all and chains them."""
