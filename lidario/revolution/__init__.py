"""Packets in, scans out: where revolutions end, and what each is made of."""
