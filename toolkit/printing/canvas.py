"""A PDF to draw on: its canvas, its wishes to the print dialog, and what it says of itself."""

from collections.abc import Mapping
from io import BytesIO
from typing import TYPE_CHECKING, Any

from toolkit import __version__
from toolkit.patches import MM_PER_INCH
from toolkit.printing.paper import Paper
from toolkit.printing.text import PLAIN

if TYPE_CHECKING:
    from reportlab.pdfgen.canvas import Canvas

POINTS_PER_MM = 72 / MM_PER_INCH


def open_canvas(buffer: BytesIO, paper: Paper) -> "Canvas":
    """A canvas for pages of that paper, in points; the same drawing gives the same bytes."""
    from reportlab.pdfgen.canvas import Canvas

    canvas = Canvas(
        buffer,
        pagesize=(paper.width_mm * POINTS_PER_MM, paper.height_mm * POINTS_PER_MM),
        pageCompression=1,
        invariant=1,
        pdfVersion=(1, 7),
        initialFontName=PLAIN,
        lang="en",
    )
    # Print dialogs that honour these start at 100 %, one-sided, on the paper of this size.
    canvas.setViewerPreference("PrintScaling", "None")
    canvas.setViewerPreference("Duplex", "Simplex")
    canvas._doc.Catalog.ViewerPreferences.dict["PickTrayByPDFSize"] = (
        "true"  # PDF 1.7; ReportLab's own list ends at 1.6
    )
    canvas.setViewerPreference("DisplayDocTitle", "true")
    return canvas


def describe_document(canvas: "Canvas", title: str, subject: str, keywords: Mapping[str, object]) -> None:
    """Fill the document's information dictionary."""
    from reportlab.pdfbase.pdfdoc import PDFDictionary, PDFInfo

    class UndatedInfo(PDFInfo):
        """ReportLab's reproducible mode writes 1 January 2000, which is false; no date is better."""

        def format(self, document: Any) -> bytes:
            from reportlab.pdfbase.pdfdoc import PDFString

            names = ("title", "author", "subject", "keywords", "creator", "producer")
            return PDFDictionary({name.title(): PDFString(getattr(self, name)) for name in names}).format(document)

    info = canvas._doc.info = UndatedInfo()
    info.title = title
    info.author = f"toolkit {__version__}"
    info.creator = f"toolkit {__version__}"
    info.producer = "ReportLab"
    info.subject = subject
    info.keywords = ", ".join(f"{name}={value}" for name, value in keywords.items())
