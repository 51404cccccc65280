"""Tables of cases, one file a module of core; the helpers beside them serve test/property and test/golden too."""
