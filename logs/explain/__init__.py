"""Why a record came about, from its trail alone: the hops from the first frame to the end, with what each compared."""
