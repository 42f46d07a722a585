"""Decode a video with OpenCV in a process of its own, and write the frames to standard output.

FFmpeg inside OpenCV kills its process on some files (uncompressed AVI, for one). Here it kills this
one, and the parent says so in one line. The file is run by its path and imports nothing of the
package, so it starts fast.

Each frame is a header (index, seconds, height, width) and its bytes, 8-bit BGR. At the end comes a
header with index -1 and the number of frames that the file announces, as the height.
"""

import os
import struct
import sys

HEADER = struct.Struct("<qdqq")
END = -1
NOT_OPENED = 3
"""Exit status for a file that OpenCV cannot open."""
OPTIONS = {
    "protocol_whitelist": "file",
    "format_whitelist": "mov,mp4,m4a,3gp,3g2,mj2,avi,matroska,webm,mpegts,mpeg,mpegvideo,flv,asf,"
    "ogg,ivf,dv,mjpeg,jpeg_pipe,mjpeg_2000,h264,hevc,m4v,av1,obu,yuv4mpegpipe,rm,mxf,nut,vc1,wtv,gif,apng",
}
"""FFmpeg opens videos, and nothing that names other files or addresses, such as playlists."""
_MJPEG = int.from_bytes(b"MJPG", "little")


def main(path: str, start: int, stop: int, step: int) -> int:
    """Write every ``step``-th frame from ``start`` to before ``stop`` (-1: to the end)."""
    options = "|".join(f"{name};{value}" for name, value in OPTIONS.items())
    os.environ["OPENCV_FFMPEG_CAPTURE_OPTIONS"] = options
    import cv2

    capture = cv2.VideoCapture(path)
    if not capture.isOpened():
        return NOT_OPENED
    announced = int(max(capture.get(cv2.CAP_PROP_FRAME_COUNT), 0))
    size = int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT)), int(capture.get(cv2.CAP_PROP_FRAME_WIDTH))
    # each frame of Motion JPEG is a JPEG file: decoding it as such is safe where the sampling of
    # colours changes within the file, which garbles frames in some versions of FFmpeg
    is_jpeg = int(capture.get(cv2.CAP_PROP_FOURCC)) == _MJPEG and _are_jpeg(path, size)
    if is_jpeg:
        capture.set(cv2.CAP_PROP_FORMAT, -1)
    rate = capture.get(cv2.CAP_PROP_FPS)
    out = sys.stdout.buffer
    index = 0
    while (stop < 0 or index < stop) and capture.grab():
        if index >= start and (index - start) % step == 0:
            good, stored = capture.retrieve()
            picture = stored if good else None
            if picture is not None and is_jpeg:
                picture = cv2.imdecode(picture.reshape(-1), cv2.IMREAD_COLOR)
            if picture is None:
                break
            if picture.ndim == 2:
                picture = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
            seconds = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            if not seconds and rate > 0:  # older versions do not know it for raw packets
                seconds = index / rate
            out.write(HEADER.pack(index, seconds, *picture.shape[:2]))
            out.write(picture[..., :3].tobytes())
            out.flush()
        index += 1
    out.write(HEADER.pack(END, 0.0, announced if stop < 0 else 0, index))
    out.flush()
    return 0


def _are_jpeg(path: str, size: tuple[int, int]) -> bool:
    """Whether the first packet of a video is a whole JPEG picture of this size (no half frame)."""
    import cv2

    capture = cv2.VideoCapture(path)
    if not capture.set(cv2.CAP_PROP_FORMAT, -1):
        return False
    good, packet = capture.read()
    if not good or packet is None:
        return False
    try:
        picture = cv2.imdecode(packet.reshape(-1), cv2.IMREAD_COLOR)
    except cv2.error:
        return False
    return picture is not None and picture.shape[:2] == size


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *map(int, sys.argv[2:5])))
