"""The words by which exports of testing machines call their columns and sizes, in several languages.

In lower case, the usual words first. English, German, French, Spanish, Italian, Chinese, Japanese and Korean.
"""

import unicodedata

TIME = (
    "time", "test time", "elapsed time", "total time", "t", "zeit", "prüfzeit", "temps", "tiempo",
    "running time", "step time", "time elapsed", "run time", "elapsed", "scan time", "machine time", "laufzeit",
    "testzeit", "messzeit", "pruefzeit", "gesamtzeit", "temps d'essai", "temps essai", "temps d’essai", "temps écoulé",
    "durée", "tiempo de ensayo", "tiempo total", "tempo", "tempo di prova", "时间", "试验时间", "测试时间", "总时间",
    "時間", "試験時間", "経過時間", "시간", "(s)", "(sec)", "(Sec)", "(seconds)", "(Seconds)", "(ms)", "(min)",
)  # fmt: skip
DISPLACEMENT = (
    "displacement", "disp", "extension", "elongation", "tensile extension", "tensile displacement", "deformation",
    "crosshead displacement", "grip displacement", "stroke", "standardweg", "weg", "traversenweg", "verlängerung",
    "déplacement", "deplacement", "allongement", "desplazamiento", "u", "d", "dl", "δl", "delta l",
    "axial displacement", "crosshead extension", "crosshead travel", "standard travel", "travel",
    "machine displacement",
    "actuator displacement",
    "ram displacement", "compressive extension", "compressive displacement", "compression",
    "indentation", "change in length", "maschine", "maschinenweg", "kolbenweg", "prüfweg", "verschiebung",
    "wegänderung", "längenänderung", "course standard", "course", "course traverse", "course de la traverse",
    "déplacement traverse", "deplacement traverse", "extensión", "carrera", "alargamiento", "spostamento", "corsa",
    "allungamento", "recorrido", "desplazamiento de la cruceta", "course machine", "位移", "横梁位移", "夹具位移",
    "拉伸位移", "压缩位移", "行程", "变形", "伸长", "伸长量", "伸長", "変位", "ストローク", "伸び", "변위", "신장",
    "クロスヘッド変位",
    "displ", "axial disp", "machine extension", "crosshead disp", "cross head displacement", "distance",
    "(mm)", "(µm)", "(um)", "(μm)",
)  # fmt: skip
POSITION = (
    "position", "pos", "crosshead", "crosshead position", "actuator", "digital position", "crosshead absolute",
    "absolute crosshead travel", "traverse abs", "traverse absolue", "position traverse", "kolbenposition", "posición",
)  # fmt: skip
LENGTH = (
    "length", "gauge length", "len", "länge", "longueur", "l", "size", "current length", "gap", "grip separation",
    "grip to grip separation", "écartement entre outils", "ecartement entre outils", "longitud",
)  # fmt: skip
STRAIN = (
    "strain", "tensile strain", "engineering strain", "nominal strain", "dehnung", "eps", "epsilon", "ε",
    "déformation", "axial strain", "eng strain", "compressive strain", "strain 1", "technische dehnung", "allongement",
    "deformación", "deformazione", "应变", "拉伸应变", "压缩应变", "應變", "ひずみ", "歪み", "변형률",
)  # fmt: skip
STRETCH = ("stretch", "stretch ratio", "length ratio", "l/l0", "lambda", "λ", "l", "streckung", "拉伸比")
FORCE = (
    "force", "load", "tensile force", "kraft", "standardkraft", "prüfkraft", "last", "fuerza", "charge", "f", "p",
    "load cell", "axial force", "axial load", "standard force", "tensile load", "compressive load", "compressive force",
    "reaction force", "rf", "normal force", "zugkraft", "druckkraft", "force standard", "effort", "carga", "forza",
    "carico", "力", "载荷", "负荷", "负载", "力值", "试验力", "拉力", "压力", "載荷", "荷重", "試験力", "하중", "힘",
    "(N)", "(kN)", "(mN)", "(lbf)", "(kgf)", "(gf)",
)  # fmt: skip
STRESS = (
    "stress", "tensile stress", "engineering stress", "nominal stress", "spannung", "contrainte", "σ", "sigma",
    "tension", "axial stress", "eng stress", "compressive stress", "esfuerzo", "sforzo", "应力", "應力", "応力", "응력",
    "拉伸应力", "压缩应力", "(MPa)", "(kPa)", "(Pa)",
)  # fmt: skip

#: Titles of columns that tell the tests of one table apart.
TESTS = (
    "id", "test", "test id", "test no", "test number", "specimen", "specimen id", "specimen no", "specimen name",
    "sample", "sample id", "sample no", "sample name", "run", "trial", "probe", "probe nr", "prüfling", "versuch",
    "éprouvette", "eprouvette", "essai", "échantillon", "probeta", "muestra", "ensayo", "provino", "试样", "试样编号",
    "编号", "样品", "試験片", "시편",
)  # fmt: skip
#: Titles of columns that tell the cycles or steps of one test apart.
CYCLES = (
    "cycle", "cycles", "cycle no", "cycle number", "cycle count", "loop", "segment", "step", "steps", "step no", "set",
    "set name", "phase", "stage", "block", "zyklus", "zyklen", "zyklus nr", "ciclo", "ciclos", "cycle n°", "循环",
    "周期", "サイクル", "사이클",
)  # fmt: skip
SIZES = {
    "length": ("length", "länge", "laenge", "messlänge", "longueur", "longitud", "anvil height", "l0", "le",
               "einspannlänge", "标距", "標距", "原始标距", "標点距離"),
    "width": ("width", "breite", "largeur", "anchura", "ancho", "b0", "宽度", "寬度", "幅"),
    "thickness": ("thickness", "dicke", "épaisseur", "epaisseur", "espesor", "a0", "厚度", "厚さ"),
    "diameter": ("diameter", "durchmesser", "diamètre", "diametre", "diámetro", "d0", "直径", "直徑", "直径"),
    "area": ("area", "cross-section", "cross section", "original cross-section", "cross-sectional area", "section",
             "querschnitt", "fläche", "sección", "s0", "面积", "截面积", "断面積"),
}  # fmt: skip
#: Titles that are nothing but a unit, in the case that leaves no doubt: ``n`` may be a number of samples.
UNITS_AS_TITLES = frozenset(
    unicodedata.normalize("NFKC", word[1:-1])
    for words in (TIME, DISPLACEMENT, FORCE, STRESS)
    for word in words
    if word.startswith("(")
)
_ALL = (TIME, DISPLACEMENT, POSITION, LENGTH, STRAIN, STRETCH, FORCE, STRESS, *SIZES.values())
#: Words with other letters than English has, by which the encoding of a file is told.
FOREIGN = (*sorted({word for words in _ALL for word in words if not word.isascii()}), "²", "µ", "°")
