"""COCO's 80 classes, and which of them an object of ImageNet's is."""

COCO_LABELS = (
    "person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat", "traffic light",
    "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog", "horse", "sheep", "cow", "elephant",
    "bear", "zebra", "giraffe", "backpack", "umbrella", "handbag", "tie", "suitcase", "frisbee", "skis", "snowboard",
    "sports ball", "kite", "baseball bat", "baseball glove", "skateboard", "surfboard", "tennis racket", "bottle",
    "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple", "sandwich", "orange", "broccoli",
    "carrot", "hot dog", "pizza", "donut", "cake", "chair", "couch", "potted plant", "bed", "dining table", "toilet",
    "tv", "laptop", "mouse", "remote", "keyboard", "cell phone", "microwave", "oven", "toaster", "sink",
    "refrigerator", "book", "clock", "vase", "scissors", "teddy bear", "hair drier", "toothbrush",
)  # fmt: skip
"""In the order in which networks trained on COCO answer."""

COCO_OF_IMAGENET = {
    "airliner": "airplane", "warplane": "airplane", "racer": "car", "sports car": "car", "convertible": "car",
    "minivan": "car", "cab": "car", "limousine": "car", "jeep": "car", "beach wagon": "car", "Model T": "car",
    "beer bottle": "bottle", "wine bottle": "bottle", "pop bottle": "bottle", "water bottle": "bottle",
    "coffee mug": "cup", "cup": "cup", "school bus": "bus", "trolleybus": "bus", "minibus": "bus",
    "mountain bike": "bicycle", "bicycle-built-for-two": "bicycle", "motor scooter": "motorcycle",
    "moped": "motorcycle",
    "garbage truck": "truck", "tow truck": "truck", "moving van": "truck", "trailer truck": "truck",
    "fire engine": "truck", "pickup": "truck", "traffic light": "traffic light", "parking meter": "parking meter",
    "park bench": "bench", "folding chair": "chair", "rocking chair": "chair", "studio couch": "couch",
    "dining table": "dining table", "toilet seat": "toilet", "television": "tv", "laptop": "laptop",
    "notebook": "laptop", "mouse": "mouse", "remote control": "remote", "computer keyboard": "keyboard",
    "cellular telephone": "cell phone", "microwave": "microwave", "toaster": "toaster", "refrigerator": "refrigerator",
    "analog clock": "clock", "wall clock": "clock", "vase": "vase", "teddy": "teddy bear", "backpack": "backpack",
    "umbrella": "umbrella", "soccer ball": "sports ball", "basketball": "sports ball", "tennis ball": "sports ball",
    "banana": "banana", "orange": "orange", "Granny Smith": "apple", "broccoli": "broccoli", "pizza": "pizza",
    "hotdog": "hot dog", "soup bowl": "bowl", "mixing bowl": "bowl", "red wine": "wine glass", "goblet": "wine glass",
    "speedboat": "boat", "fireboat": "boat", "lifeboat": "boat", "gondola": "boat", "yawl": "boat",
}  # fmt: skip
"""ImageNet's name -> COCO's, where the one is a kind of the other."""


def coco_names(label: str) -> list[str]:
    """What COCO may call a class: its own name, then that of the kind which it is of."""
    plain = label.replace("_", " ")
    kind = COCO_OF_IMAGENET.get(plain)
    return [plain] if kind is None else [plain, kind]
