"""Pages in a browser."""

from selenium.webdriver.support.ui import WebDriverWait


def opened(browser, file, *, width=1280, scheme="light"):
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 500}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    browser.get(
        "about:blank"
    )  # the same address once more is a reload, whose end the driver may miss on a busy machine
    browser.get_log("browser")
    browser.get(file.as_uri())
    WebDriverWait(browser, 60).until(lambda b: b.execute_script("return document.readyState") == "complete")
    return browser
