"""Words for messages."""


def counted(number: int, what: str) -> str:
    """So many: ``1 scan``, ``2 scans``."""
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
