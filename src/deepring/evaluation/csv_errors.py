"""Why a CSV file cannot be read, in our own words."""

import csv

#: The errors that opening and reading a CSV file raises.
CSV_ERRORS = (OSError, UnicodeDecodeError, csv.Error)


def csv_reason(error: Exception) -> str:
    """What is wrong with the file, for one of `CSV_ERRORS`."""
    if isinstance(error, OSError):
        return f"cannot be read ({error.strerror})"
    return "is not UTF-8 text" if isinstance(error, UnicodeDecodeError) else "is not valid CSV"
