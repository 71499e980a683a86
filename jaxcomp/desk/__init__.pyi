from ._serve import page as page
from ._serve import serve as serve
