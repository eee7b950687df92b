"""The words by which exports of testing machines call their columns and sizes, in several languages.

In lower case, the usual words first. English, German, Dutch, Swedish, Danish, Norwegian, Finnish, French, Spanish,
Italian, Portuguese, Romanian, Polish, Czech, Slovak, Slovenian, Croatian, Serbian, Russian, Ukrainian, Hungarian,
Greek, Turkish, Indonesian, Chinese, Japanese and Korean.
"""

import unicodedata

TIME = (
    "time", "test time", "elapsed time", "total time", "t", "zeit", "prüfzeit", "temps", "tiempo",
    "running time", "step time", "time elapsed", "run time", "elapsed", "scan time", "machine time", "laufzeit",
    "testzeit", "messzeit", "pruefzeit", "gesamtzeit", "temps d'essai", "temps essai", "temps d’essai", "temps écoulé",
    "durée", "tiempo de ensayo", "tiempo total", "tempo", "tempo di prova", "时间", "试验时间", "测试时间", "总时间",
    "czas", "godzina", "測定日時", "日時", "時間", "試験時間", "経過時間", "시간",
    "время", "время испытания", "sampling time", "saat", "zaman", "süre", "geçen süre",
    "tijd", "testtijd", "tid", "testtid", "provtid", "aika", "timp", "čas", "vrijeme", "vreme", "час", "idő", "χρόνος",
    "waktu",
    "time on sample", "общее время", "полное время", "time since start of test", "time since start", "timestamp",
    "time stamp",
    "zeitstempel", "(s)", "(sec)", "(Sec)", "(seconds)", "(Seconds)", "(ms)", "(min)",
    "(millis)", "(Millis)",
)  # fmt: skip
DISPLACEMENT = (
    "displacement", "disp", "displacment",
    "extension", "elongation", "tensile extension", "tensile displacement", "deformation",
    "crosshead displacement", "grip displacement", "stroke", "standardweg", "weg", "traversenweg", "verlängerung",
    "déplacement", "deplacement", "allongement", "desplazamiento", "u", "d", "dl", "δl", "delta l",
    "axial displacement", "displacement into surface", "pd", "penetration depth", "crosshead extension",
    "crosshead travel", "standard travel", "travel",
    "machine displacement",
    "actuator displacement",
    "ram displacement", "compressive extension", "compressive displacement", "compression",
    "indentation", "change in length", "maschine", "maschinenweg", "kolbenweg", "prüfweg", "verschiebung",
    "corsa traversa", "spostamento traversa",
    "wegänderung", "längenänderung", "course standard", "course", "course traverse", "course de la traverse",
    "déplacement traverse", "deplacement traverse", "extensión", "carrera", "alargamiento", "spostamento", "corsa",
    "allungamento", "recorrido", "desplazamiento de la cruceta", "course machine",
    "déplacement en traction", "déplacement en compression", "extensión de tracción", "extensión por tracción",
    "desplazamiento en tracción", "deslocamento", "extensão", "alongamento", "extn", "stauchung", "disp feedback",
    "displacement feedback", "axial displacement feedback", "位移", "横梁位移", "夹具位移",
    "拉伸位移", "压缩位移", "行程", "伸长", "伸长量", "伸長", "変位", "ストローク", "변위", "신장",
    "クロスヘッド変位",
    "displ", "axial disp", "machine extension", "extension from preload",
    "elong", "crosshead disp", "cross head displacement", "crosshead separation", "distance", "depth",
    "standardwegaufnehmer", "eindringtiefe", "desplaz", "przemieszczenie", "wydłużenie",
    "перемещение", "удлинение", "перемещение траверсы", "relative displacement", "uzama", "yer değiştirme",
    "slack ext", "slack extension", "slack corrected extension",
    "verplaatsing", "verlenging", "förskjutning", "förflyttning", "förlängning", "forskydning", "forlængelse",
    "forskyvning", "forlengelse", "siirtymä", "pidentymä", "deplasare", "alungire", "posunutí", "posun", "dráha",
    "prodloužení", "protažení", "predĺženie", "pomik", "raztezek", "pomak", "pomeranje", "produljenje", "produženje",
    "izduženje", "переміщення", "подовження", "elmozdulás", "megnyúlás", "μετατόπιση", "επιμήκυνση", "perpindahan",
    "pertambahan panjang",
    "(mm)", "(µm)", "(um)", "(μm)",
)  # fmt: skip
#: Displacements and strains of the specimen itself, which count before those of the machine.
EXTENSOMETER = (
    "extensometer elongation", "wegaufnehmer", "deflection", "durchbiegung",
    "extensometer", "extensometer 1", "extensometer displacement", "extensometer extension", "extensometer strain",
    "axial extensometer", "video extensometer", "clip gauge", "lvdt", "feindehnung", "feindehnungsaufnehmer", "feinweg",
    "dehnungsaufnehmer", "extensomètre", "extensometre", "extensómetro", "extensometro", "extensômetro", "estensimetro",
    "estensometro", "ext", "ext.", "déform", "déform1", "deform", "deform1", "引伸计", "引伸計", "变形", "變形",
    "伸び", "伸び計",
    "伸び 1", "신율계", "연신계",
)  # fmt: skip
#: Displacements that are strains where their unit is that of a ratio: ``Elongation (%)``.
ELONGATION = (
    "elongation", "elong", "extension", "extn", "deformation", "verlängerung", "alargamiento", "allungamento",
    "alongamento", "伸长", "伸長",
)  # fmt: skip
POSITION = (
    "position", "pos", "crosshead", "crosshead position", "actuator", "digital position", "crosshead absolute",
    "absolute crosshead travel", "traverse abs", "traverse absolue", "position traverse", "traverse", "traversa",
    "kolbenposition", "position des aktuators", "digitale position", "position de l'actionneur",
    "z sense", "z sensor",
    "posición", "posit", "положение", "c.head", "c. head", "c head", "actuator position", "ram position",
    "piston position", "machine position",
)  # fmt: skip
LENGTH = (
    "length", "gauge length", "len", "länge", "longueur", "l", "size", "current length", "gap", "grip separation",
    "grip to grip separation", "écartement entre outils", "ecartement entre outils", "longitud", "tool distance",
    "tool separation", "werkzeugabstand",
)  # fmt: skip
STRAIN = (
    "strain", "tensile strain", "engineering strain", "nominal strain", "dehnung", "eps", "epsilon", "ε",
    "déformation", "axial strain", "eng strain", "compressive strain", "stroke strain",
    "crosshead strain", "strain 1", "technische dehnung", "stauchung",
    "déformation en traction", "déformation en compression",
    "deformación por tracción", "deformação", "allongement",
    "deformación", "deformazione", "应变", "拉伸应变", "压缩应变", "應變", "ひずみ",
    "ストロークひずみ", "行程应变", "歪み", "변형률", "odkształcenie", "деформация", "относительная деформация",
    "rek", "töjning", "tøjning", "tøyning", "venymä", "poměrné prodloužení", "pomerné predĺženie", "deformacija",
    "deformácia", "deformace", "деформація", "nyúlás", "fajlagos nyúlás", "παραμόρφωση", "regangan",
    "creep strain", "gerinim", "gerinme", "çekme gerinimi", "çekme gerinmesi", "basma gerinimi", "basma gerinmesi",
)  # fmt: skip
#: Forces along axes, of which one is that of the test.
ALONG_AXES = ("fx", "fy", "fz")
#: Words for a stretch that some use for a strain.
STRETCH_OR_STRAIN = ("stretch", "streckung")
STRETCH = ("stretch", "stretch ratio", "length ratio", "l/l0", "lambda", "λ", "l", "streckung", "拉伸比")
FORCE = (
    "force", "load", "fz", "tensile force", "kraft", "standardkraft", "prüfkraft", "last", "fuerza", "charge", "f", "p",
    "load cell", "axial force", "axial load", "standard force", "tensile load", "compressive load", "compressive force",
    "reaction force", "rf", "normal force", "zugkraft", "druckkraft", "force standard", "effort", "carga", "forza",
    "carico", "força", "static force", "force feedback", "axial force feedback", "load feedback", "axial load feedback",
    "load on sample", "scale", "fn", "kracht", "trekkracht", "voima", "forță", "forţă", "forta", "síla", "sila", "erő",
    "δύναμη", "gaya", "beban",
    "machine load", "obciążenie", "siła", "усилие", "нагрузка", "сила", "yük", "kuvvet",
    "力", "载荷", "负荷", "负载", "力值", "试验力", "拉力", "压力", "載荷", "荷重", "試験力", "하중", "힘",
    "(N)", "(kN)", "(mN)", "(lbf)", "(kgf)", "(gf)",
)  # fmt: skip
STRESS = (
    "stress", "tensile stress", "engineering stress", "nominal stress", "spannung", "contrainte", "σ", "sigma",
    "tension", "axial stress", "eng stress", "compressive stress", "esfuerzo", "sforzo",
    "contrainte en traction", "contrainte en compression", "esfuerzo de tracción", "esfuerzo a tracción", "tensão", "p",
    "应力", "應力", "応力", "응력",
    "spanning", "trekspanning", "spänning", "spænding", "spenning", "jännitys", "tensiune", "napětí", "napätie",
    "napetost", "naprezanje", "напруження", "feszültség", "τάση", "tegangan",
    "gerilme", "çekme gerilmesi", "basma gerilmesi",
    "naprężenie", "напряжение", "拉伸应力", "压缩应力", "(MPa)", "(kPa)", "(Pa)", "(GPa)", "(psi)", "(ksi)",
)  # fmt: skip
#: By which a title or a line above a table tells of a compression.
COMPRESSION = (
    "compressi", "compresi", "druckversuch", "druckprüfung", "druckkraft", "druckspannung", "stauchung",
    "stauchversuch", "压缩", "壓縮", "圧縮", "압축", "ściskan", "ściskaj", "сжати", "basma ger", "basma dene",
    "drukproef", "drukkracht", "drukspanning", "tryckprov", "trykprøv", "trykkprøv", "puristus", "tlakov", "tlačn",
    "стиск", "nyomóvizsg", "θλίψη", "tekan",
)  # fmt: skip
#: By which a title or a line above a table tells that a specimen is indented, which is a push.
INDENTATION = (
    "indent", "into surface", "load on sample", "penetration depth", "eindring", "eindruck", "压入", "壓入",
)  # fmt: skip
#: By which a title or a line above a table tells of a bending.
BENDING = (
    "flexur", "bending", "3 point bend",
    "biegung", "biegeversuch", "biegeprüf", "biegespannung", "biegefest", "flexion", "flexión", "flessione", "flexão",
    "buigproef", "buigspanning", "böjprov", "bøjning", "bøyning", "taivutus", "ohyb", "savijan", "hajlítás", "згин",
    "弯曲", "彎曲", "曲げ", "굽힘", "zginan", "изгиб",
)  # fmt: skip
#: By which a line above a table tells of the fixture of a bending.
BENDING_FIXTURES = (
    "support span", "3-point", "three-point", "4-point", "four-point", "soportes", "auflagerabstand", "stützweite",
    "entre appuis", "支点間距離", "跨距",
)  # fmt: skip
#: Beside one of them, the line tells nothing: "tension/compression load cell".
TENSION = (
    "tension", "tensile", "traction", "zug", "tracción", "trazione", "拉", "引張", "인장", "rozciąg", "растяж", "çekme",
    "trekproef", "trekkracht", "trekspanning", "dragprov", "trækprøv", "strekkprøv", "vetokoe", "tahov", "ťahov",
    "natezn", "vlačn", "zatezn", "розтяг", "szakítóvizsg", "εφελκυσ", "tarik",
)  # fmt: skip

#: Titles of times, displacements and forces that also mean something else: a column may hold another quantity.
DOUBTFUL = frozenset({
    "step time", "scan time", "sampling time", "tempo", "laufzeit",
    "depth", "eindringtiefe", "crosshead separation", "dráha", "deformace", "deformácia", "deformacija", "деформація",
    "spanning", "spänning", "spænding", "spenning", "tensiune", "napětí", "napätie", "napetost", "feszültség",
    "tegangan", "τάση",
    "deformation", "compression", "indentation", "distance", "travel", "course", "carrera", "corsa", "recorrido", "u",
    "d", "dl", "δl", "maschine", "stroke", "ストローク", "行程",
    "pd", "fn", "f", "fz", "p", "rf", "last", "charge", "effort", "carga", "carico", "load cell", "normal force",
    "static force",
    "压力", "负载", "하중",
})  # fmt: skip

#: Titles of columns that tell the tests of one table apart.
TESTS = (
    "id", "test", "test id", "test no", "test number", "specimen", "specimen id", "specimen no", "specimen name",
    "sample", "sample id", "sample no", "sample name", "run", "trial", "probe", "probe nr", "prüfling", "versuch",
    "éprouvette", "eprouvette", "essai", "échantillon", "probeta", "muestra", "ensayo", "provino", "试样", "试样编号",
    "编号", "样品", "試験片", "시편",
)  # fmt: skip
#: Titles of columns with the speed of the motion.
SPEEDS = (
    "vel", "velocity", "speed", "test speed", "crosshead speed", "rate", "strain rate", "displacement rate",
    "geschwindigkeit", "prüfgeschwindigkeit", "dehnrate", "dehngeschwindigkeit", "vitesse", "vitesse d'essai",
    "vitesse de déformation", "velocidad", "velocidad de ensayo", "velocità", "速度", "试验速度", "应变速率",
    "試験速度", "속도",
)  # fmt: skip
#: Titles of columns that tell the cycles or steps of one test apart.
CYCLES = (
    "cycle", "cycles", "cycle no", "cycle number", "cycle count", "loop", "segment", "step", "steps", "step no", "set",
    "set name", "phase", "stage", "block", "zyklus", "zyklen", "zyklus nr", "ciclo", "ciclos", "cycle n°", "循环",
    "周期", "サイクル", "사이클",
)  # fmt: skip
#: Titles of times that begin again with each step of one test.
TIMES_OF_STEPS = ("step time", "segment time")
#: Titles of columns of words that stand in some rows only.
REMARKS = (
    "event", "events", "comment", "comments", "note", "notes", "remark", "remarks", "marker", "markers", "message",
    "status", "flag", "ereignis", "bemerkung", "kommentar", "commentaire", "comentario", "commento", "evento",
)  # fmt: skip
SIZES = {
    "length": ("length", "länge", "l\ufffdnge", "laenge", "messlänge", "longueur", "longitud", "anvil height", "l0",
               "le", "einspannlänge", "lunghezza", "lunghezza iniziale", "lunghezza utile", "lunghezza libera",
               "标距", "標距", "原始标距", "標点距離", "標点間距離",
               "wysokość kowadełka", "uzunluk", "ölçü uzunluğu",
               "longitud inicial", "długość", "длина", "начальная длина",
               "lengte", "meetlengte", "längd", "mätlängd", "længde", "målelængde", "lengde", "pituus", "mittapituus",
               "lungime", "délka", "měřená délka", "dĺžka", "dolžina", "duljina", "dužina", "duzina", "dužina l0",
               "duzina l0", "довжина", "hossz", "μήκος", "panjang",
               "chuck distance", "grip distance", "チャック間距離", "つかみ具間距離"),
    "width": ("width", "breite", "largeur", "anchura", "ancho", "larghezza", "larghezza b", "largura", "b0",
              "szerokość", "genişlik", "宽度", "寬度", "幅", "ширина",
              "breedte", "bredd", "bredde", "leveys", "lățime", "lăţime", "šířka", "šírka", "širina", "sirina",
              "širina b", "sirina b", "szélesség", "πλάτος", "lebar"),
    "thickness": ("thickness", "dicke", "épaisseur", "epaisseur", "espesor", "spessore", "spessore a",
                  "espessura", "grubość", "a0", "kalınlık",
                  "厚度", "厚さ", "толщина",
                  "dikte", "tjocklek", "tykkelse", "paksuus", "grosime", "tloušťka", "hrúbka", "debelina", "debljina",
                  "debljina a", "товщина", "vastagság", "πάχος", "tebal"),
    "diameter": ("diameter", "durchmesser", "diamètre", "diametre", "diámetro", "diametro", "diametro iniziale",
                 "średnica", "çap", "d0", "直径", "直徑", "直径", "диаметр",
                 "halkaisija", "diametru", "průměr", "priemer", "premer", "promjer", "prečnik", "precnik", "діаметр",
                 "átmérő", "διάμετρος"),
    "area": ("area", "cross-section", "cross section", "original cross-section", "cross-sectional area", "section",
             "querschnitt", "fläche", "sección", "sezione",
             "sezione iniziale", "s0", "kesit alanı", "площадь", "площадь сечения", "площадь поперечного сечения",
             "oppervlakte", "doorsnede", "tvärsnittsarea", "tværsnitsareal", "tverrsnittsareal", "poikkipinta-ala",
             "plocha", "průřez", "prierez", "presek", "površina", "povrsina", "površina s0", "povrsina s0", "площа",
             "keresztmetszet", "διατομή", "luas penampang",
             "面积", "截面积", "断面積"),
}  # fmt: skip
#: The length of a round specimen that is compressed; beside a width, a height may be a side of the cross-section.
HEIGHT = ("height", "höhe", "hoehe", "probenhöhe", "hauteur", "altura", "altezza", "wysokość", "высота", "高度", "高さ",
          "높이", "hoogte", "höjd", "højde", "høyde", "korkeus", "înălțime", "výška", "višina", "visina", "висота",
          "magasság", "ύψος", "tinggi")  # fmt: skip
#: Titles that are nothing but a unit, in the case that leaves no doubt: ``n`` may be a number of samples.
UNITS_AS_TITLES = frozenset(
    unicodedata.normalize("NFKC", word[1:-1])
    for words in (TIME, DISPLACEMENT, FORCE, STRESS)
    for word in words
    if word.startswith("(")
)
_ALL = (TIME, DISPLACEMENT, EXTENSOMETER, POSITION, LENGTH, STRAIN, STRETCH, FORCE, STRESS, *SIZES.values())
#: Words with other letters than English has, by which the encoding of a file is told.
FOREIGN = (*sorted({word for words in _ALL for word in words if not word.isascii()}), "²", "µ", "°")
