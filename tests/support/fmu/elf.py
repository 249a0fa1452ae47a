"""What a shared library of Linux says of itself (by <elf.h>), so that no test needs a machine's binutils."""

import struct

DYNSYM, WEAK = 11, 2


def elf(content):
    """Return sizes of sections by name, and the names of the symbols that are exported and that are needed."""
    start, count, names = struct.unpack_from("<Q", content, 40)[0], *struct.unpack_from("<HH", content, 60)
    headers = list(struct.iter_unpack("<IIQQQQIIQQ", content[start : start + 64 * count]))

    def text(table, place):
        begin = headers[table][4] + place
        return content[begin : content.index(0, begin)].decode()

    exported, needed = set(), set()
    for _, kind, _, _, place, size, link, *_ in headers:
        if kind == DYNSYM:
            symbols = list(struct.iter_unpack("<IBBHQQ", content[place : place + size]))[1:]
            for name, info, _, section, *_ in symbols:
                if section:
                    exported.add(text(link, name))
                elif info >> 4 != WEAK:
                    needed.add(text(link, name))
    return {text(names, header[0]): header[5] for header in headers}, exported, needed
