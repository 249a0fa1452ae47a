"""The kind of FMU that pythonfmu makes: the importer's process needs Python."""
